"""A prepared policy that thinks at each decision, as long as it may."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.climbing import Ascent
from mdpo_rddl.policy.agent import PolicyAgent
from mdpo_rddl.policy.lookahead.base import Climbed, Gain, Method, Prepared, Situation
from mdpo_rddl.policy.lookahead.belief import Believer, is_unmatched, known_at, note_played
from mdpo_rddl.policy.lookahead.expectation import Expectation
from mdpo_rddl.policy.lookahead.halving import Halving
from mdpo_rddl.policy.lookahead.played_plan import PlayedPlan
from mdpo_rddl.policy.lookahead.simulator import NARROW, WIDE, Simulator
from mdpo_rddl.problem.grounding import (
    grounded,
    is_grounded,
    lifted,
    require_batch,
    require_observation,
    require_step,
)
from mdpo_rddl.problem.legality import LARGEST_ROUNDING
from mdpo_rddl.problem.load import Problem

# of a decision's time: when the search ends, when the finalists' test ends
_SEARCH_SHARE, _TEST_SHARE = 0.65, 0.9
# the base is left for a gain of more than so many errors
_ERRORS = 1.0
_MOST_TEST_CALLS = 30
# real actions that are played differ by so little at most from what was decided
_ROUNDING = 2.0 * LARGEST_ROUNDING
# time for so many calls of the simulator in each round
_ROUND_CALLS = 1.5


class Decision(NamedTuple):
    """How one decision was made.

    Attributes:
      step: its number in its episode.
      seconds: wall time from the state to the action.
      calls: of the simulator.
      left_base: whether something else than the prepared policy's action was chosen, and played.
      gain: what the episode is expected to return more for it, in fresh rollouts; 0 without them.
        Where nothing is random, what it adds to what the episode's decisions before it expect.
        Else, more than for the base, 0 where its action is played; of a candidate that changes
        later steps too, what it gains a step.
      error: the gain's standard error.
      unmatched: whether the belief had no particle that could have led to what was observed.
      replaced: whether another action than the decision's was played; its gain is not expected.
    """

    step: int
    seconds: float
    calls: int
    left_base: bool
    gain: float
    error: float
    unmatched: bool = False
    replaced: bool = False


class LookaheadPolicy(PolicyAgent):
    """Plays the base policy's action unless another one is better in paired rollouts.

    At each decision a method proposes candidates. They are halved on common scenarios, and the
    best are tested on fresh ones. The base is left only for a gain beyond its standard error. An
    agent of pyRDDLGym's, as the base is.

    Attributes:
      method: proposes candidates.
      decisions: every decision so far.
    """

    def __init__(
        self,
        simulator: Simulator,
        method: Method,
        seconds: float,
        seed: int,
        clock: Callable[[], float] = time.perf_counter,
        is_unknown: Callable[[Mapping[str, Any]], bool] | None = None,
    ) -> None:
        """Takes what is prepared.

        Args:
          simulator: prepared for decisions of so many seconds.
          method: one that applies to the problem.
          seconds: of a decision.
          seed: of all decisions.
          clock: tells the seconds.
          is_unknown: whether a state is one of those that it thinks in; in all if None.
        """
        self.method, self.decisions = method, list[Decision]()
        self._is_unknown = is_unknown
        self._simulator, self._seconds, self._clock = simulator, seconds, clock
        self._plan = PlayedPlan(simulator.depth, simulator.horizon, simulator.components)
        discount = float(simulator.policy.problem.model.discount)
        self._expectation = Expectation(simulator.is_random, discount)
        self._random = np.random.default_rng(seed)
        self._known: Mapping[str, Any] = {}
        self._decided: Mapping[str, Any] = {}
        self._base_action = np.zeros(0)

    @property
    def problem(self) -> Problem:
        """What is played."""
        return self.base.problem

    @property
    def label(self) -> str:
        """How it thinks, and where, for people."""
        with_state = isinstance(self.base, Believer) and self.base.continuing is not None
        kind = ", QMDP" if with_state else ""
        return self.method.name + kind + (", in unknown states" if self._is_unknown else "")

    def save(self, path: str | Path) -> None:
        """Writes the prepared policy, which can be loaded and given time to think again."""
        self.base.save(path)

    def __reduce__(self) -> Any:
        raise InputError(
            "a policy that thinks cannot be pickled: save or pickle its `base`, and ask that for "
            "with_decision_seconds again"
        )

    @property
    def base(self) -> Prepared:
        """The prepared policy."""
        return self._simulator.policy

    def __call__(self, step: int, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """The action at a step; step 0 begins a new episode.

        Args:
          step: number of decisions before.
          observation: per fluent an array, or per ground fluent a scalar.

        Returns:
          Per action fluent an array, or per ground action fluent a scalar, as the observation was.

        Raises:
          InputError: if there is no such step, or fluents are unknown, missing or of another shape.
        """
        model = self.problem.model
        require_step(model, step)
        require_observation(model, observation)
        if is_grounded(model, observation):
            return grounded(model, self(step, lifted(model, observation)))
        if step == 0:
            self.begin()
        return self._exact(self.decide(step, observation)[0], observation)

    def begin(self) -> None:
        """An episode begins: the last one again, with its plan, where the model has no draws.

        Who asks for the decision at step 0 by `decide` calls this before.
        """
        self._expectation.begin()
        self._go_to(0)

    def forget(self) -> None:
        """An episode begins of which nothing is known."""
        self._plan.forget()
        self._expectation.forget()
        self.method.reset()

    def _go_to(self, step: int) -> None:
        """The next decision is the one at this step; by chance, that of an unknown episode."""
        if self._simulator.may_draw:
            self.forget()
        self._plan.go_to(step)
        if not self._simulator.may_draw:
            self.method.resume(self._plan.rest)

    def batch(self, step: int, observations: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """As `PolicyAgent.batch`; of several observations each is decided on from nothing.

        What a method keeps from step to step belongs to one episode.

        Raises:
          InputError: if the state is not observed and they are of several episodes: a belief is of
            one.
        """
        count = require_batch(self.problem.model, step, observations)
        if count > 1 and isinstance(self.base, Believer):
            raise InputError(
                f"there are {count} observations at step {step}: a policy that thinks where the "
                "state is not observed plays one episode at a time"
            )
        if count == 1:
            return super().batch(step, observations)
        actions = []
        for each in range(count):
            self.forget()
            own = {name: values[each : each + 1] for name, values in observations.items()}
            actions.append(super().batch(step, own))
        self.forget()
        return {name: np.concatenate([action[name] for action in actions]) for name in actions[0]}

    def decide(
        self, step: int, state: Mapping[str, Any], seconds: float | None = None
    ) -> tuple[Mapping[str, Any], np.ndarray, np.ndarray]:
        """Makes a decision and records it.

        Args:
          step: its number.
          state: as a vectorized environment shows it; of a problem that is observed in part only,
            a belief stands for itself.
          seconds: for this decision, if not as for all.

        Returns:
          The action, the candidate that it comes from and candidate 0 [k, D].
        """
        with self.base.planner.computing():
            return self._decide(step, state, self._seconds if seconds is None else seconds)

    def _decide(
        self, step: int, state: Mapping[str, Any], seconds: float
    ) -> tuple[Mapping[str, Any], np.ndarray, np.ndarray]:
        started = self._clock()
        if step != self._plan.step:
            self._go_to(step)
        components, state = self._simulator.components, known_at(self.base, step, state)
        proposed = self.base(step, state)
        base = np.zeros((self._simulator.depth, components.size), np.float32)
        base[0] = components.flat(proposed)
        play = Halving(self._simulator, state, step, base, self._clock, self._new_seed)
        chosen, followed = self._best(play, started, seconds)
        candidate = base if chosen is None else chosen.candidate
        self.method.shift(candidate)
        self._plan.shift(candidate, base[0])
        left = bool(np.any(candidate[0] != base[0]))
        action = components.action(candidate[0], proposed) if left else proposed
        self._known, self._decided, self._base_action = state, action, base[0]
        note_played(self.base, state, action)
        gain, error = self._expectation.decided(step, chosen, followed, left)
        took = self._clock() - started
        unmatched = is_unmatched(state)
        self.decisions.append(Decision(step, took, play.calls, left, gain, error, unmatched))
        return action, candidate, base

    def was_played(self, actions: Mapping[str, Any]) -> None:
        """Takes in what was played at the latest decision, where it may not be what was decided.

        Args:
          actions: per action fluent [*shape].
        """
        note_played(self.base, self._known, actions)
        if self._decided and not self._is_decided(played := self._flat(actions)):
            self._plan.replace(played, self._base_action)
            last = self.decisions[-1]
            gain = self._expectation.replaced(last.step)
            self.decisions[-1] = last._replace(left_base=False, gain=gain, error=0.0, replaced=True)

    def _is_decided(self, played: np.ndarray) -> bool:
        """Whether this [D] is what was decided last, but for what a referee rounds."""
        parts, decided = self._simulator.components, self._flat(self._decided)
        # where an equality holds, one takes what is rounded of the largest
        largest = 1.0 + np.max(np.abs(decided[parts.is_real]), initial=0.0)
        rounded = _ROUNDING * np.maximum(largest, np.abs(decided - parts.noop))
        return bool(np.all(np.abs(played - decided) <= np.where(parts.is_real, rounded, 0.0)))

    def _flat(self, actions: Mapping[str, Any]) -> np.ndarray:
        """Actions as one vector [D]."""
        planner = self.base.planner
        numbers = {name: planner.numbers(name, value) for name, value in actions.items()}
        return self._simulator.components.flat(numbers)

    def _best(
        self, play: Halving, started: float, seconds: float
    ) -> tuple[Gain | None, Gain | None]:
        """The finalist to play, None for the base; and the plan that was followed, if tested.

        A plan that an earlier decision has begun needs no gain beyond its error: it may have
        paid its price already, and where the policy is no more ready to go on alone.
        """
        if self._is_unknown is not None and not self._is_unknown(play.state):
            return None, None
        followed = self._followed(play)
        test_until = started + _TEST_SHARE * seconds
        a_test = self._simulator.seconds(NARROW, play.step)
        search_until = min(started + _SEARCH_SHARE * seconds, test_until - a_test)
        if self._clock() + self._simulator.seconds(WIDE, play.step) > search_until:
            self._simulator.expect_less()
            return None if followed is None else Gain(followed, 0.0, 0.0), None
        finalists = self._finalists(play, search_until, followed)
        if not len(finalists):
            return None, None
        tested = play.test(finalists, test_until, _MOST_TEST_CALLS)
        if followed is not None and all(gain.mean == -np.inf for gain in tested):
            return Gain(followed, 0.0, 0.0), None

        def goes_on(gain: Gain) -> bool:
            return followed is not None and np.array_equal(gain.candidate, followed)

        def is_good(gain: Gain) -> bool:
            return gain.mean > (0.0 if goes_on(gain) else _ERRORS * gain.error)

        best = max(filter(is_good, tested), key=lambda gain: gain.rate, default=None)
        return best, next(filter(goes_on, tested), None)

    def _followed(self, play: Halving) -> np.ndarray | None:
        """What is left of the plan [n, D]; where its next action is illegal, without that one."""
        followed = self._plan.followed(play.base[0])
        if followed is not None and not self._simulator.legal(play.state, followed[:1])[0]:
            followed[0] = play.base[0]
        return followed if followed is not None and np.any(followed != play.base) else None

    def _finalists(self, play: Halving, until: float, followed: np.ndarray | None) -> np.ndarray:
        """The best of all rounds, the plan that is followed among them [n, k, D]."""
        self.method.begin(self._situation(play, until - self._clock()))
        # of what was proposed again the latest gain: it was not chosen for that one
        best: dict[bytes, Gain] = {}
        gains: Sequence[Gain] = ()
        rounds, began = self.method.rounds, self._clock()
        most = self._simulator.challengers(NARROW)
        for number in range(rounds):
            proposals = self.method.propose(gains, self._random)
            if not len(proposals):
                break
            proposals = self._plan.padded(proposals)
            legal = self._simulator.legal(play.state, proposals[:, 0])
            if not np.any(legal):
                break
            # later rounds get what an earlier one has left, and each can make a call
            end = began + (number + 1) / rounds * (until - began)
            a_call = self._clock() + _ROUND_CALLS * self._simulator.seconds(WIDE, play.step)
            gains = play.run(proposals[legal], min(max(end, a_call), until))
            best |= {gain.candidate.tobytes(): gain for gain in gains[:most] if gain.mean > 0.0}
            if not gains:
                break
        ranked = sorted(best.values(), key=lambda gain: -gain.rate)
        found = [gain.candidate for gain in ranked[:most]]
        if followed is not None and not any(np.array_equal(each, followed) for each in found):
            found = [*found[: most - 1], followed]
        return np.array(found)

    def _situation(self, play: Halving, seconds: float) -> Situation:
        """What the method begins with, if the search has so many seconds."""

        simulator = self._simulator
        # what was reached is compared in a call
        a_call = max(simulator.seconds(kind, play.step) for kind in (WIDE, NARROW))
        most = seconds - _ROUND_CALLS * a_call

        def climb(ascent: Ascent, rates: np.ndarray, share: float) -> Climbed | None:
            depth = ascent.candidates.shape[1]
            place, missing = (play.state, play.step), simulator.depth - depth
            padded = ascent.changed(lambda part: np.pad(part, ((0, 0), (0, missing), (0, 0))))
            padded = padded._replace(candidates=self._plan.padded(ascent.candidates))
            # what the method does not keep must not move
            all_rates = rates[:, np.newaxis] * (np.arange(simulator.depth) < depth)
            found = simulator.climb(place, padded, all_rates, min(share * seconds, most))
            if found is None:
                return None
            own = found.ascent.changed(lambda part: part[:, :depth])
            return Climbed(own, found.sigma[:, :depth])

        base, capacity = play.base[0], simulator.challengers(WIDE)
        return Situation(base, capacity, climb, simulator.climbers)

    def _new_seed(self) -> int:
        return int(self._random.integers(2**31))
