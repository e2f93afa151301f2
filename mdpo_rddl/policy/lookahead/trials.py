"""Short paired trials of methods: what their decisions gain at states that the policy visits."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.gains import steps_to_last_change
from mdpo_rddl.policy.lookahead.simulator import NARROW, WIDE, Simulator

State = Mapping[str, Any]

MOST_STATES = 60
"""At so many states a method is tried at most."""
FEWEST_STATES = 3
"""Gains at fewer states say nothing."""
NO_TIME = "no time"

# where there is little time, decisions take as little as so many calls, but at least this share of
# those in play
_FEWEST_CALLS, _SHORTEST_SHARE = 5.0, 0.2
# for so many states the decisions are shortened
_WANTED_STATES = 30
# calls with fresh scenarios after the decisions of a state
_TEST_CALLS = 4
# a gain must be so many standard errors, as in a decision: what is chosen for a gain that is none
# loses next to nothing, since its decisions leave the base for a gain only
_ERRORS = 1.0
# trials end early where the best method's gain is so many errors, and above others' by so many
_CLEAR, _CLEARLY_BETTER, _CLEAR_STATES = 6.0, 3.0, 20


@dataclass(frozen=True)
class Trial:
    """What a method gained a decision, at states that the base policy visits or in episodes.

    Of a candidate that changes later steps too, what it gains a step until its last change counts,
    or all of it where nothing is random.

    Attributes:
      method: its name.
      mean: gain of a decision in rollouts that the decision did not see; None without a result.
      error: the mean's standard error over the scenarios; None without a result.
      note: why there is no result; empty if there is one.
      states: at which the method decided.
      beyond: so many standard errors the gain must be to pay.
    """

    method: str
    mean: float | None
    error: float | None
    note: str = ""
    states: int = 0
    beyond: float = _ERRORS

    @property
    def pays(self) -> bool:
        """Whether the gain is so many standard errors."""
        if self.mean is None or self.error is None:
            return False
        return self.mean > self.beyond * self.error


@dataclass
class Trials:
    """Decisions of several methods at common states, tested on common scenarios.

    The states are taken as they are: a gain's error is that of its scenarios. Most decisions gain
    nothing, since the base is played, and a few gain much. The error over the states of a mean of
    such gains is about as large as the mean, however certain each gain is.

    Attributes:
      thinkers: one for each method; their decisions are forgotten.
      simulator: tests the decisions on fresh scenarios.
      seconds: of a decision in play.
      clock: tells the seconds.
    """

    thinkers: Sequence[LookaheadPolicy]
    simulator: Simulator
    seconds: float
    clock: Callable[[], float]
    _gains: list[np.ndarray] = field(default_factory=list, init=False)

    def at(self, visited: Sequence[tuple[int, State]], until: float) -> list[Trial]:
        """Decides at the states in turn, until the time is over or the best method is clear.

        Args:
          visited: steps and states.
          until: no state is begun that is likely to end later.
        """
        longest, decision = 0.0, self._decision_seconds(until)
        for number, (step, state) in enumerate(visited[:MOST_STATES]):
            before = self.clock()
            if before + longest > until or self._is_clear():
                break
            self._gains.append(self._at(number, (step, state), decision))
            longest = max(longest, self.clock() - before)
        enough = len(self._gains) >= FEWEST_STATES
        return [self._trial(place, enough) for place in range(len(self.thinkers))]

    def _decision_seconds(self, until: float) -> float:
        """Of a decision in the trials: as in play if there is time for that at many states."""
        wanted = (until - self.clock()) / (_WANTED_STATES * len(self.thinkers))
        calls = _FEWEST_CALLS * self.simulator.seconds(WIDE, 0) / self.seconds
        shortest = float(np.clip(calls, _SHORTEST_SHARE, 1.0))
        return float(np.clip(wanted, shortest * self.seconds, self.seconds))

    def _at(self, number: int, place: tuple[int, State], seconds: float) -> np.ndarray:
        """Gains of the methods' decisions at a state [methods, N], zero where the base is played.

        Args:
          number: of the state, from which the scenarios follow.
          place: step and state.
          seconds: of a decision.
        """
        step, state = place
        chosen, base = [], np.zeros(0)
        for thinker in self.thinkers:
            _, candidate, base = thinker.decide(step, state, seconds)
            chosen.append(candidate)
            # what is known of this state is of no episode that is played
            thinker.forget()
        seeds = range(number * _TEST_CALLS, (number + 1) * _TEST_CALLS)
        most = self.simulator.challengers(NARROW)
        differs = [p for p, candidate in enumerate(chosen) if not np.array_equal(candidate, base)]
        gains = np.zeros((len(chosen), 1))
        for start in range(0, len(differs), most):
            places = differs[start : start + most]
            played = np.stack([base, *(chosen[p] for p in places)])
            calls = [self.simulator.gains(NARROW, state, step, played, seed) for seed in seeds]
            fresh = np.concatenate(calls, axis=1)
            if gains.shape[1] == 1:
                gains = np.zeros((len(chosen), fresh.shape[1]))
            gains[places] = fresh
            # what is gained a step; without chance a plan is kept, and all its gain is had
            if self.simulator.is_random:
                left = self.simulator.horizon - step
                steps = [steps_to_last_change(chosen[p], base, left) for p in places]
                gains[places] /= np.array(steps)[:, np.newaxis]
        return gains

    def _is_clear(self) -> bool:
        """Whether the best method pays beyond doubt, and is beyond doubt the best."""
        if len(self._gains) < _CLEAR_STATES:
            return False
        best = int(np.argmax([np.mean([g[p].mean() for g in self._gains]) for p in self._places]))
        mean, error = _mean_and_error([gains[best] for gains in self._gains])
        others = [
            _mean_and_error([gains[best] - gains[other] for gains in self._gains])
            for other in self._places
            if other != best
        ]
        return mean > _CLEAR * error and all(m > _CLEARLY_BETTER * e for m, e in others)

    @property
    def _places(self) -> range:
        return range(len(self.thinkers))

    def _trial(self, place: int, enough: bool) -> Trial:
        thinker = self.thinkers[place]
        has_played = any(decision.calls for decision in thinker.decisions)
        thinker.decisions.clear()
        if not (enough and has_played):
            return Trial(thinker.method.name, None, None, NO_TIME)
        mean, error = _mean_and_error([gains[place] for gains in self._gains])
        return Trial(thinker.method.name, mean, error, states=len(self._gains))


def _mean_and_error(gains: Sequence[np.ndarray]) -> tuple[float, float]:
    """Of the mean over given states of the mean gains in the scenarios [N] of each."""
    means = [float(np.mean(each)) for each in gains]
    squares = [float(np.var(each)) / max(1, each.size - 1) for each in gains]
    return float(np.mean(means)), float(np.sqrt(np.sum(squares)) / len(gains))
