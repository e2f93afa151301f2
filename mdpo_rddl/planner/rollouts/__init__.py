"""Compiled rollouts of the model."""
