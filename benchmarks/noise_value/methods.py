"""The rules that are compared, and the configurations that they are compared in."""

import dataclasses
from dataclasses import dataclass

import jax
import jax.numpy as jnp

from mdpo_rddl.noise import AnnealedNoise
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.jaxplan_configs import jaxplan_config

NONE, TWICE = "none", "none-twice"

DEFAULT = "constant beside"
"""The planner's own rule where it is given none, `default_noise()`."""

ABSOLUTE, RANGE = "absolute", "range"

# a cycle of the annealed rule that no training sees the end of: its scale stays
_FOREVER = 1e9


@dataclass(frozen=True)
class Lane:
    """One training of all seeds.

    Attributes:
      sigma_min, sigma_max: of the adaptive rule; where they are the same, the noise is constant.
      anneals: whether the scale falls in the cycles of `AnnealedNoise`.
      unit: of the two.
      stream: which initial parameters. The random numbers of the rollouts are the same for all, so
        that the test returns of two trainings differ by their parameters alone.
    """

    sigma_min: float = 0.0
    sigma_max: float = 0.0
    anneals: bool = False
    unit: str = RANGE
    stream: int = 0

    def rule(self) -> AnnealedNoise:
        """The rule, with arrays for numbers, so that a sigma of 0 is the same program."""
        annealed = AnnealedNoise()
        rule = AnnealedNoise(
            sigma_min=self.sigma_min,
            sigma_max=annealed.sigma_max if self.anneals else self.sigma_max,
            cycle=annealed.cycle if self.anneals else _FOREVER,
            power=annealed.power,
            paired=False,
            unit=self.unit,
        )
        return jax.tree.map(lambda number: jnp.asarray(number, jnp.float32), rule)

    def in_range_units(self, unit: float) -> AnnealedNoise:
        """The rule of an absolute sigma where a unit of the range is so many of the action's."""
        rule = dataclasses.replace(self, unit=RANGE).rule()
        return dataclasses.replace(
            rule.scaled(1.0 / unit), regularization=unit * rule.regularization
        )


def lanes(sigma: float) -> dict[str, Lane]:
    """What is trained.

    Args:
      sigma: of the constant rules, and the largest of the adaptive one, as a share of the range.
    """
    return {
        NONE: Lane(),
        "constant": Lane(sigma, sigma),
        "adaptive": Lane(0.0, sigma),
        "annealed companion": Lane(anneals=True, stream=1),
        "constant companion": Lane(sigma, sigma, stream=1),
        "second": Lane(stream=1),
        "paper": Lane(0.0, 10.0, unit=ABSOLUTE),
    }


METHODS = {
    NONE: (NONE,),
    TWICE: (NONE, "second"),
    "constant": ("constant",),
    "annealed beside": (NONE, "annealed companion"),
    DEFAULT: (NONE, "constant companion"),
    "adaptive": ("adaptive",),
    "paper": ("paper",),
}
"""Per method its trainings, of which a seed keeps the best iterate by JaxPlan's own test.

`none` is JaxPlan's planner. Those beside it train a companion with noise for each of JaxPlan's
parallel updates, with initial parameters of its own, as the planner's default does; but here its
rollouts have the random numbers of JaxPlan's update, and there their own. `none-twice` has a
second update without noise instead, so that what the noise adds can be told from what a second
update adds.
"""


def task_config(problem: str, plan: str, configuration: str, seeds: int) -> PlannerConfig:
    """JaxPlan's configuration for a problem, else its default, for all seeds side by side.

    Args:
      problem: name in rddlrepository.
      plan: "slp" or "drp".
      configuration: "own", or "no-pgpe" for the same without PGPE.
      seeds: each has the parallel updates that the configuration names.
    """
    config = jaxplan_config(problem, plan).without_section("Noise")
    if configuration == "no-pgpe":
        config = config.with_values("Planner", pgpe=None)
    return config.with_values("Planner", parallel_updates=seeds * updates_of(config))


def updates_of(config: PlannerConfig) -> int:
    """The parallel updates of a configuration."""
    return int(config.section("Planner").get("parallel_updates", 1))


def has_pgpe(config: PlannerConfig) -> bool:
    """Whether a configuration has PGPE, as JaxPlan does unless told otherwise."""
    return config.section("Planner").get("pgpe", "GaussianPGPE") is not None


def with_rule(config: PlannerConfig, unit: str) -> PlannerConfig:
    """A configuration with the rule of all lanes of a unit."""
    section = {"method": "AnnealedNoise", "unit": unit, "paired": False}
    return config.with_section("Noise", section)
