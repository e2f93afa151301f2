"""The names that the command line offers, for those who import no JAX."""

PLANS = ("drp", "slp")

# what counts as a strong noise, in units of the domain's actions (RecSim: of its logits)
SCALES = {
    "HVAC": 10.0,
    "MarsRover": 1.0,
    "MountainCar": 1.0,
    "PowerGen": 10.0,
    "RaceCar": 1.0,
    "RecSim": 1.0,
    "Reservoir": 10.0,
    "UAV": 1.0,
}
