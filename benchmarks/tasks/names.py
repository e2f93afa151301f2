"""The names that the command line offers, for those who import no JAX."""

OURS = "mdpo"
THINKING = "mdpo-thinking"
WHOLE = "auto"
WITHOUT_NOISE = "auto-without-noise"
NOISE = "adaptive noise"
NOOP, RANDOM = "noop", "random"
PLANNERS = (OURS, "jaxplan-slp", "jaxplan-drp", NOOP, RANDOM)

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
ABLATION_TASKS = (
    "hvac10",
    "hvac20",
    "powergen7",
    "powergen11",
    "reservoir15",
    "reservoir30",
    "AcademicAdvising_ippc2018:11",
    "BinPacking_or:0",
    "CartPole_Discrete_gym:0",
    "CooperativeRecon_MDP_ippc2011:6",
    "CrossingTraffic_MDP_ippc2011:6",
    "CrossingTraffic_POMDP_ippc2014:6",
    "Elevators:1",
    "Elevators_POMDP_ippc2011:6",
    "GameOfLife_MDP_ippc2011:6",
    "HVAC_ippc2023:4",
    "Knapsack_or:0",
    "MarsRover_ippc2023:3",
    "MountainCar_ippc2023:3",
    "Navigation_POMDP_ippc2011:6",
    "Pizza_rddlsim:0",
    "PowerGen_Discrete:0",
    "PushYourLuck_ippc2018:11",
    "Reacher_physics:1",
    "Reservoir_Continuous:1",
    "Sidewalk_rddlsim:1",
    "SkillTeaching_POMDP_ippc2011:6",
    "Sudoku_arcade:1",
    "SysAdmin_POMDP_ippc2011:6",
    "Tamarisk_POMDP_ippc2014:6",
    "TrafficBLX_ComplexPhases:0",
    "Traffic_CTM_POMDP_ippc2011:6",
    "TriangleTireworld_MDP_ippc2014:6",
    "UAV_Discrete:0",
    "Wildfire_MDP_ippc2014:6",
    "Zombies_arcade:2",
)
"""The paper's settings, and every third problem of rddlrepository with its middle instance."""
SHARING_TASKS = ABLATION_TASKS[6:]
"""The same but for the paper's settings."""
HIDDEN_TASKS = (
    "AcademicAdvising_POMDP_ippc2014:3",
    "CooperativeRecon_POMDP_ippc2011:3",
    "CrossingTraffic_POMDP_ippc2011:3",
    "CrossingTraffic_POMDP_ippc2014:3",
    "Elevators_POMDP_ippc2011:3",
    "Elevators_POMDP_ippc2014:3",
    "GameOfLife_POMDP_ippc2011:3",
    "Navigation_POMDP_ippc2011:3",
    "SkillTeaching_POMDP_ippc2011:3",
    "SkillTeaching_POMDP_ippc2014:3",
    "SysAdmin_POMDP_ippc2011:3",
    "Tamarisk_POMDP_ippc2014:3",
    "Traffic_CTM_POMDP_ippc2011:3",
    "Traffic_POMDP_ippc2014:3",
    "TriangleTireworld_POMDP_ippc2014:3",
    "Wildfire_POMDP_ippc2014:3",
)
"""The sixteen domains of rddlrepository whose state is not observed."""
ANYTIME_SECONDS = (5.0, 10.0, 20.0, 45.0, 90.0, 300.0)
