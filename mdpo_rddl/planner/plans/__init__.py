"""Plans and policies of ours, and what they are made of."""
