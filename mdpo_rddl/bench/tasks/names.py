"""The names that the command line offers, for those who import no JAX."""

OURS = "mdpo"
THINKING = "mdpo-thinking"
PLANNERS = (OURS, "jaxplan-slp", "jaxplan-drp", "noop", "random")
