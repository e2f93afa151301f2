"""The preset `auto` with one part left out or exchanged: what each part is worth."""

from collections.abc import Callable
from typing import Any

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.fitting import without_plan
from mdpo_rddl.planner.config.search_section import OPTIONAL_ARMS, SEARCH


def without(arm: str) -> str:
    """The name of the variant without an arm."""
    return f"auto-without-{arm.replace(' ', '-')}"


def _searching(**shares: Any) -> Callable[[PlannerConfig], PlannerConfig]:
    return lambda config: config.with_values(SEARCH, **shares)


def _planning(**values: Any) -> Callable[[PlannerConfig], PlannerConfig]:
    return lambda config: config.with_values("Planner", **values)


def _shaped(**arguments: Any) -> Callable[[PlannerConfig], PlannerConfig]:
    return lambda config: config.with_policy_arguments(**arguments)


VARIANTS: dict[str, Callable[[PlannerConfig], PlannerConfig]] = {
    "auto": lambda config: config,
    **{without(name): _searching(without=[name]) for name in OPTIONAL_ARMS},
    "auto-without-noise": PlannerConfig.without_noise,
    "auto-with-analysis-rollouts": lambda c: c.with_values("Noise", analysis_samples=1),
    "auto-without-open-loop-part": without_plan,
    "auto-without-net": _shaped(topology=[]),
    "auto-without-cosines-and-squares": _shaped(cosines=0, squares=False),
    "auto-with-closed-loop-gradient": _shaped(cut_feedback=False),
    "auto-with-plain-adam": _planning(optimizer="adam"),
}
"""Per name what is done to the preset's configuration."""
