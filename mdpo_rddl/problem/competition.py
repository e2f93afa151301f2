"""The domains of the 2023 competition."""

REPOSITORY_NAMES = {
    "hvac": "HVAC_ippc2023",
    "mars_rover_science_mission": "MarsRover_ippc2023",
    "mountain_car": "MountainCar_ippc2023",
    "power_gen": "PowerGen_ippc2023",
    "racecar": "RaceCar_ippc2023",
    "recsim_ecosystem_welfare": "RecSim_ippc2023",
    "reservoir_control_cont": "Reservoir_ippc2023",
    "kinematic_UAVs_con": "UAV_ippc2023",
}
"""Per name that the RDDL file gives its domain, the problem's name in rddlrepository."""
