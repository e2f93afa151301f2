"""What is known of policies that the judge does not play."""

import dataclasses
import logging
from collections.abc import Sequence

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.simple import CONSTANT, SIMPLE
from mdpo_rddl.auto.candidate import NOOP, Candidate

logger = logging.getLogger(__name__)


def known_by_probing(arena: Arena) -> list[Candidate]:
    """The no-op and the best constant, with their returns in the few rollouts of the probing."""
    probe = arena.probe
    found = ((NOOP, arena.noop, probe.noop_return), (CONSTANT, arena.constant, probe.start_return))
    return [
        dataclasses.replace(arena.candidate(SIMPLE, label, params), mean=mean, error=0.0)
        for label, params, mean in found
    ]


def known_without_rollouts(arena: Arena, initial: Sequence[Candidate]) -> list[Candidate]:
    """The best constant of the probing, and what an earlier race has left.

    Args:
      arena: of a large problem.
      initial: policies to begin with; those that were not judged are left out.
    """
    logger.warning("there is too little time to search: a rollout takes so long")
    _, constant = known_by_probing(arena)
    return [constant, *(candidate for candidate in initial if candidate.mean is not None)]
