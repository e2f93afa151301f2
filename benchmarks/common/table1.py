"""Table 1 of arXiv 2605.07520: mean and standard deviation over 20 seeds."""

from typing import NamedTuple


class Published(NamedTuple):
    """One cell of the paper's table."""

    mean: float
    std: float


_SETTINGS = ("hvac10", "hvac20", "powergen7", "powergen11", "reservoir15", "reservoir30")
_MEANS_AND_STDS = {
    "ppo": (
        (-4706559.94, -5799263.08, -119950.01, -120000.00, -1567404.88, -3821075.16),
        (0.38, 0.21, 217.92, 0.00, 258.54, 226.01),
    ),
    "deterministic": (
        (-3268060.37, -5799274.81, -38565.41, -57528.37, -683721.06, -2219640.67),
        (441267.23, 44.65, 25582.69, 30444.41, 221923.57, 296596.36),
    ),
    "jaxplan": (
        (-2987355.11, -5793011.93, -44747.36, -54034.04, -688683.95, -2364420.45),
        (979087.04, 89429.51, 33219.89, 24745.46, 205670.07, 388492.15),
    ),
    "constant-1": (
        (-1693569.37, -5799302.46, 6753.42, 16345.46, -249675.61, -1217795.17),
        (129419.57, 17.11, 5279.33, 3977.71, 20927.82, 151823.21),
    ),
    "constant-3": (
        (-1555612.12, -5799423.99, 4622.72, 13772.41, -248132.79, -1115865.90),
        (47196.07, 58.96, 7027.73, 5851.97, 21170.60, 69979.64),
    ),
    "adaptive": (
        (-1371468.0, -2086875.93, 10076.0, 16890.15, -246613.49, -815510.27),
        (194.35, 42832.24, 3925.23, 3138.48, 18382.48, 59029.69),
    ),
}
TABLE: dict[tuple[str, str], Published] = {
    (setting, method): Published(mean, std)
    for method, (means, stds) in _MEANS_AND_STDS.items()
    for setting, mean, std in zip(_SETTINGS, means, stds, strict=True)
}
"""By setting and method."""
