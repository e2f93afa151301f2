"""The names that the command line offers, for those who import no JAX."""

NOISE_VALUE_PLANS = ("slp", "drp")
CONFIGURATIONS = ("own", "no-pgpe")

DEFAULT_SIGMA = 0.1
"""The default rule's, as a share of the action's range."""
