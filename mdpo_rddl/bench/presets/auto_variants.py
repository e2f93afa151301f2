"""The preset `auto` with one part left out or exchanged: what each part is worth."""

from collections.abc import Callable
from typing import Any

from mdpo_rddl.auto.fitting import without_plan
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.search_section import OPTIONAL_ARMS, SEARCH

# a search must have some time, if only to compile
_NO_TIME = 0.02


def _searching(**shares: Any) -> Callable[[PlannerConfig], PlannerConfig]:
    return lambda config: config.with_values(SEARCH, **shares)


def _planning(**values: Any) -> Callable[[PlannerConfig], PlannerConfig]:
    return lambda config: config.with_values("Planner", **values)


def _shaped(**arguments: Any) -> Callable[[PlannerConfig], PlannerConfig]:
    return lambda config: config.with_policy_arguments(**arguments)


VARIANTS: dict[str, Callable[[PlannerConfig], PlannerConfig]] = {
    "auto": lambda config: config,
    "auto-without-searches": _searching(shared_until=_NO_TIME, own_until=_NO_TIME),
    "auto-without-own-weights": _searching(shared_until=0.32, own_until=0.32),
    **{f"auto-without-{name}": _searching(without=[name]) for name in OPTIONAL_ARMS},
    "auto-without-last-search": _searching(rounds_until=1.0),
    "auto-without-noise": lambda config: config.with_section("Noise", {"method": "NoNoise"}),
    "auto-with-analysis-rollouts": lambda c: c.with_values("Noise", analysis_samples=1),
    "auto-without-plan": without_plan,
    "auto-without-net": _shaped(topology=[]),
    "auto-without-cosines-and-squares": _shaped(cosines=0, squares=False),
    "auto-with-closed-loop-gradient": _shaped(cut_feedback=False),
    "auto-with-plain-adam": _planning(optimizer="adam"),
}
"""Per name what is done to the preset's configuration."""
