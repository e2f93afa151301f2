"""The names that the command line offers, for those who import no JAX."""

OPTIMA_INSTANCES = ("1", "3", "5", "7", "9")
