"""The names that the command line offers, for those who import no JAX."""

NOISES = {"none": {"method": "NoNoise"}, "adaptive": None}
"""Per name the section [Noise]; None is the preset's own."""

VARIANT_NAMES = (
    "auto",
    "auto-without-searches",
    "auto-without-own-weights",
    "auto-without-gradient",
    "auto-without-pgpe",
    "auto-without-slp",
    "auto-without-drp",
    "auto-without-last-search",
    "auto-without-noise",
    "auto-with-analysis-rollouts",
    "auto-without-plan",
    "auto-without-net",
    "auto-without-cosines-and-squares",
    "auto-with-closed-loop-gradient",
    "auto-with-plain-adam",
)
PLANNERS = ("expert", *VARIANT_NAMES, "jaxplan-slp", "jaxplan-drp")
