"""The names that the command line offers, for those who import no JAX."""

NOISE_VALUE_PLANS = ("slp", "drp")
CONFIGURATIONS = ("own", "no-pgpe")
