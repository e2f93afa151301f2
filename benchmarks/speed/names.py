"""The names that the command line offers, for those who import no JAX."""

SPEED_SETTINGS = ("powergen7", "reservoir30", "hvac20")

# sizes, and of what
AXES: dict[str, tuple[int, ...]] = {
    "horizon": (40, 120, 240, 480, 960),
    "reservoirs": (10, 30, 100, 300),
    "zones": (10, 30, 100, 300),
    "restarts": (1, 4, 16, 64, 256),
}
