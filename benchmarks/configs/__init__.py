"""The choice of the shipped configurations."""
