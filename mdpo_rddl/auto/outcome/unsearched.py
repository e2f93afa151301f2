"""What is known of policies that the judge does not play."""

import dataclasses
import logging
import math
from collections.abc import Iterator

import numpy as np

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.simple import CONSTANT, RANDOM_RULE, SIMPLE
from mdpo_rddl.auto.common.candidate import NOOP, Candidate
from mdpo_rddl.auto.probing.probing import without_units
from mdpo_rddl.auto.search.weights import flat_vector
from mdpo_rddl.planner.plans.feedback import Params

logger = logging.getLogger(__name__)

# of rollouts of the no-op and the best constant; of the time left, at most
_BATCHES, _BATCHES_SHARE = 16, 0.1
# the seeds of two searches, far from those of other races
_APART = 10**6


def known_by_probing(arena: Arena) -> list[Candidate]:
    """The no-op and the best constant, with their mean returns in the few rollouts of the probing.

    Where chance plays no part, the return of each of the judge's rollouts is known, unless the
    problem is so large that these are not to be compared with the environment's.
    """
    probe, count = arena.probe, arena.judge.rollouts
    is_known = probe.deterministic and probe.policy_seconds is None
    found = ((NOOP, arena.noop, probe.noop_return), (CONSTANT, arena.constant, probe.start_return))
    return [
        dataclasses.replace(
            arena.candidate(SIMPLE, label, params),
            mean=mean,
            error=0.0,
            returns=np.full(count, mean) if is_known else None,
        )
        for label, params, mean in found
    ]


def correct_by_probing(arena: Arena) -> None:
    """Tells the judge what the no-op and the best constant return in more rollouts of the probing.

    Args:
      arena: whose judge knows both by `known_by_probing`.
    """
    assert arena.probed is not None
    probe, judge, plays = arena.probe, arena.judge, arena.probed.plays
    if probe.deterministic:
        return  # these are known
    left = _BATCHES_SHARE * (arena.deadline - arena.clock())
    batches = int(min(_BATCHES, left / max(plays.seconds, 1e-9)))
    start = without_units(probe.units, probe.start)
    noop = {name: np.zeros_like(values) for name, values in start.items()}
    returns = plays.fresh_returns(noop, start, batches)
    if returns.shape[1] < 2:
        return
    for label, own in zip((NOOP, CONSTANT), returns, strict=True):
        if (candidate := judge.latest(label)) is not None:
            judge.correct(candidate, own)


def found_by_probing(arena: Arena) -> Iterator[Candidate]:
    """Rules, found by the program that has played the probing's constants, while there is time.

    In turn one is searched from others, and the best so far goes on. Each is told by rollouts of
    its own.
    """
    probed, deadline, clock, seed = arena.probed, arena.deadline, arena.clock, arena.seed
    best: Candidate | None = None
    begin: Params | None = None
    while probed is not None and probed.has_time(deadline, clock):
        arena.pulse()
        found = probed.best_rule((SIMPLE, RANDOM_RULE), seed, deadline, clock, begin)
        # a rule that was told before would only be told by other luck
        if begin is None or not _are_alike(begin, found.params):
            yield found
            best = found if best is None else max(best, found, key=_known)
        begin = best.params if begin is None and best is not None else None
        seed = (seed + _APART) % 2**31


def _known(candidate: Candidate) -> float:
    return candidate.known_mean if math.isfinite(candidate.known_mean) else -math.inf


def _are_alike(one: Params, other: Params) -> bool:
    return bool(np.array_equal(flat_vector(one), flat_vector(other)))


def constant_without_rollouts(arena: Arena) -> Candidate:
    """The best constant of the probing.

    Args:
      arena: of a problem that is too large for a search.
    """
    logger.warning("there is too little time to search: a rollout takes so long")
    return known_by_probing(arena)[1]
