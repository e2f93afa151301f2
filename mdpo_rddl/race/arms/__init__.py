"""Ways to find a policy."""
