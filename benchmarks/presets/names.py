"""The names that the command line offers, for those who import no JAX."""

NOISES = {"none": {"method": "NoNoise"}, "adaptive": None}
"""Per name the section [Noise]; None is the preset's own."""

VARIANT_NAMES = (
    "auto",
    "auto-without-dynamic-programming",
    "auto-without-relaxed-plans",
    "auto-without-random-rules",
    "auto-without-plans",
    "auto-without-greedy",
    "auto-without-shared-weights",
    "auto-without-own-weights",
    "auto-without-gradient",
    "auto-without-plan-by-gradient",
    "auto-without-action-voting",
    "auto-without-noise",
    "auto-with-analysis-rollouts",
    "auto-without-open-loop-part",
    "auto-without-net",
    "auto-without-cosines-and-squares",
    "auto-with-closed-loop-gradient",
    "auto-with-plain-adam",
)
PLANNERS = ("expert", *VARIANT_NAMES, "jaxplan-slp", "jaxplan-drp")
EARLIER = "recipe"
"""Rows of the recipe before the race, which commit 46bb4a9 has made as `auto`."""

TRANSFER_PAIRS = (
    "HVAC_ippc2023:1:3",
    "PowerGen_ippc2023:1:3",
    "Reservoir_ippc2023:1:3",
    "SysAdmin_MDP_ippc2011:1:5",
    "Elevators_MDP_ippc2011:1:3",
    "UAV_ippc2023:1:3",
    "MarsRover_ippc2023:1:3",
)
"""Problem, the instance whose policy is carried over, the instance that it is carried to."""
