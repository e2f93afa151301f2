"""The rule of a planner that is given none."""

from mdpo_rddl.noise.base import ActionNoise
from mdpo_rddl.noise.constant import ConstantNoise


def default_noise() -> ActionNoise:
    """Constant noise of a tenth of the range, beside an update without noise, which is JaxPlan's.

    `python -m benchmarks noise-value` compares it with others (`docs/noise.md`).
    """
    return ConstantNoise(paired=True)
