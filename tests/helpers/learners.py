"""The arm that learns a value, on toy problems, whose programs are compiled once."""

import functools
import time
from dataclasses import replace

import numpy as np

from helpers.clocks import Ticking
from helpers.lakes import preset
from helpers.toys import toy
from mdpo_rddl.auto import RaceOptions
from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.arms.policy_iteration import PolicyIterationArm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.race import race

SECONDS = 300.0
# 3 for the best of three arms, of which one may be pulled, at each of 4 steps
BEST = 3.0 * 0.75 * 4
_TOYS = {
    "lever": {
        "RULES": "forall_{?a : arm} [pull(?a) => true];",
        "LIKELIHOOD": "0.75",
        "DISCOUNT": "1.0",
        "TERMINATION": "false",
        "MOST": "1",
    },
    "locks": {
        "GOAL": "(forall_{?l : lock} [open(?l)])",
        "TERMINATION": "",
        "FIRST": "open(l1) = false;",
    },
}
# what `_compile` makes
_PROGRAMS = ("_planner", "_iteration")


def ticking_arena(name: str = "lever") -> Arena:
    """One whose judge knows the no-op only, and whose clock ticks."""
    clock, compiled = Ticking(), _compiled_arena(name)
    judge = Judge(128, 0, clock, 0.0)
    judge._players = compiled.judge._players
    arena = replace(compiled, judge=judge, clock=clock, began=0.0, deadline=SECONDS)
    judge.record(arena.candidate("", "no-op", arena.noop))
    return arena


def compiled_arm(arena: Arena, until: float = 120.0) -> PolicyIterationArm:
    """An arm whose programs are compiled already, so that its thread is not waited for."""
    name = arena.problem.domain_name
    arm, built = PolicyIterationArm(arena, until), _built(name)
    for name in _PROGRAMS:
        setattr(arm, name, getattr(built, name))
    arm._is_compiled = lambda until: True
    return arm


def known(arena: Arena) -> Candidate:
    """The best policy, with large odds, as another arm has found it."""
    bias = np.array([-9.0, -9.0, 9.0], np.float32)
    own = {"pull": {**arena.noop["own"]["pull"], "bias": bias}}
    return arena.candidate("other", "known", {**arena.noop, "own": own})


def taken(arm: Arm, judge: Judge) -> list[Candidate]:
    """The candidates of a slice, as the judge sees them."""
    found = []
    for candidate in arm.take_candidates():
        judge.record(candidate)
        found.append(judge.judged[-1].candidate)
        arm.judged(found[-1])
    return found


@functools.cache
def _compiled_arena(name: str) -> Arena:
    arena = race._arena(
        toy(name, **_TOYS[name]), preset(SECONDS), 0, time.monotonic(), RaceOptions()
    )
    arena.judge.record(arena.candidate("", "no-op", arena.noop))
    return arena


@functools.cache
def _built(name: str) -> PolicyIterationArm:
    """An arm that has compiled what learns."""
    arm = PolicyIterationArm(_compiled_arena(name), 0.0)
    arm._compile()
    return arm
