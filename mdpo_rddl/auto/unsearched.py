"""What there is where a rollout takes too long for any search."""

import dataclasses
import logging
from collections.abc import Sequence

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.simple import CONSTANT, SIMPLE
from mdpo_rddl.auto.candidate import Candidate

logger = logging.getLogger(__name__)


def known_without_rollouts(arena: Arena, initial: Sequence[Candidate]) -> list[Candidate]:
    """The best constant of the probing, and what an earlier race has left.

    Args:
      arena: of a large problem.
      initial: policies to begin with; those that were not judged are left out.
    """
    logger.warning("there is too little time to search: a rollout takes so long")
    constant = arena.candidate(SIMPLE, CONSTANT, arena.constant)
    known = dataclasses.replace(constant, mean=arena.probe.start_return, error=0.0)
    return [known, *(candidate for candidate in initial if candidate.mean is not None)]
