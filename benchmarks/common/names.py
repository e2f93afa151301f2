"""The names that the command line offers, for those who import no JAX."""

SETTINGS = ("hvac10", "hvac20", "powergen7", "powergen11", "reservoir15", "reservoir30")
"""The paper's six settings, shipped problems all of them."""
