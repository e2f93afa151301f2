"""The names that the command line offers, for those who import no JAX."""

OURS = "mdpo"
THINKING = "mdpo-thinking"
PLANNERS = (OURS, "jaxplan-slp", "jaxplan-drp", "noop", "random")

ANYTIME_TASKS = (
    "HVAC_ippc2023:3",
    "MarsRover_ippc2023:3",
    "PowerGen_ippc2023:3",
    "RaceCar_ippc2023:1",
    "Reservoir_ippc2023:3",
    "UAV_ippc2023:3",
    "SupplyChain_or:0",
    "CrossingTraffic_MDP_ippc2011:3",
    "Elevators_MDP_ippc2011:5",
    "SysAdmin_MDP_ippc2011:5",
    "Tamarisk_MDP_ippc2014:5",
    "Wildfire_MDP_ippc2014:5",
)
"""Twelve of all kinds: continuous, hybrid and discrete, small and large."""
ANYTIME_SECONDS = (5.0, 10.0, 20.0, 45.0, 90.0, 300.0)
