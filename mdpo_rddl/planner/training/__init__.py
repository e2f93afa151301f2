"""A training: how it goes on, what it has found, what is kept of it."""
