"""Configurations: files, presets, checks."""
