"""Measurements of the presets."""
