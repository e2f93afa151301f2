"""The policy that a race has before anything is compiled: the no-op."""

import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mdpo_rddl.auto.arms.simple import SIMPLE
from mdpo_rddl.auto.common.candidate import NOOP, Candidate
from mdpo_rddl.planner.config.fitting import without_scales
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.search_section import SEARCH
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import Problem, make_environment

logger = logging.getLogger(__name__)

_EPISODES = 4


class _LateError(Exception):
    """The first episode takes too long."""


def first_policy(
    problem: Problem, config: PlannerConfig, seed: int, go_on: Callable[[], bool]
) -> Candidate | None:
    """The no-op, with its mean return in a few episodes on the exact environment.

    Its error is left infinite, for so few episodes say little of it. None if the planner cannot
    be built, and the arms then say why, if a return is not finite, or if no episode ends in time.

    Args:
      problem: the parsed problem.
      config: of the race.
      seed: of the episodes.
      go_on: asked for after each episode, and before each step of the first one.
    """
    episodes = 0

    def noop(step: int, state: Mapping[str, Any]) -> dict[str, Any]:
        if not episodes and not go_on():
            raise _LateError(f"the first episode is at step {step}, and its time is over")
        return {}

    def played_one() -> bool:
        nonlocal episodes
        episodes += 1
        return go_on()

    config = without_scales(config.without_section(SEARCH))
    try:
        planner = build_planner(problem, config).planner
        params = planner.feedback_plan.noop(seed)
        env = make_environment(problem)
        played = evaluate(env, noop, _EPISODES, seed, played_one)
    except Exception as error:
        logger.info("no policy to begin with: %s", one_line_cause(error))
        return None
    mean = float(np.mean(played.worth))
    return (
        Candidate(SIMPLE, NOOP, config, planner, params, mean=mean) if np.isfinite(mean) else None
    )
