"""Sweeps over problems."""
