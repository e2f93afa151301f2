"""A simulator of the toy with three arms, whose calls take a given time."""

from dataclasses import dataclass, field

import numpy as np

from helpers.clocks import Stopped
from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.lookahead.simulator import NARROW, WIDE


@dataclass
class SlowSimulator:
    """A simulator whose calls take a given time, and in which a3 alone pays, at random."""

    policy: object
    clock: Stopped
    durations: dict
    preparation: float = 0.0
    may_draw: bool = True
    is_random: bool = True
    climbers: int = 1
    horizon: int = 4
    depth: int = 12
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def __post_init__(self):
        self.components = Components.of(self.policy.planner)

    def prepare(self, state, seconds, until, others):
        self.clock.now += self.preparation
        return True

    def seconds(self, kind, step):
        return self.durations[kind]

    def expect_less(self):
        pass

    def challengers(self, kind):
        return {WIDE: 7, NARROW: 3}[kind]

    def legal(self, state, actions):
        return np.ones(len(actions), bool)

    def gains(self, kind, state, step, candidates, seed):
        self.clock.now += self.durations[kind]
        extra = candidates[1:, 0, 2] - candidates[0, 0, 2]
        return extra[:, np.newaxis] + self.random.normal(size=(len(extra), 16))
