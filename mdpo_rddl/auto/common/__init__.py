"""What all parts of a race share: candidates, states that are kept, the clock."""
