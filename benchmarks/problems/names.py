"""The names that the command line offers, for those who import no JAX."""

DOMAINS = (
    "HVAC",
    "MarsRover",
    "MountainCar",
    "PowerGen",
    "RaceCar",
    "RecSim",
    "Reservoir",
    "UAV",
)
INSTANCES = ("1", "2", "3", "4", "5")
