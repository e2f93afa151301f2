"""The names that the command line offers, for those who import no JAX."""

OURS = "mdpo"
PLANNERS = (OURS, "jaxplan-slp", "jaxplan-drp", "noop", "random")
