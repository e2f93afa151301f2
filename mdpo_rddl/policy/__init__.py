"""What maps a state to an action."""
