"""Paired rollouts of candidates, compiled, in calls whose duration is known."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from mdpo_rddl.noise import AdaptiveNoise
from mdpo_rddl.planner.climbing import Ascent, Climbing, ClimbSize
from mdpo_rddl.planner.exact.continuations import Continuations, HiddenRoot, Size
from mdpo_rddl.policy.lookahead.base import Climbed, Prepared, rollout_params
from mdpo_rddl.policy.lookahead.belief import Belief
from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.lookahead.gains import paired_gains
from mdpo_rddl.problem.chance import has_draws
from mdpo_rddl.problem.observation import as_numbers

WIDE, NARROW = "wide", "narrow"
# candidates that climb side by side; where nothing is random one makes more steps
_CLIMBERS = 4
# over how many scenarios and steps their return is differentiated, if anything is random
_CLIMB_SCENARIOS, _CLIMB_WINDOW = 4, 100
_CLIMB_STREAM = 2**31  # other random keys than those of the rollouts
_NOISE = AdaptiveNoise(sigma_min=0.1, sigma_max=1.0)
_MEASURED_STEPS, _MOST_CLIMBS = 20, 5000
# candidates of a call, the base among them; the rest of its size are scenarios
_CANDIDATES = {WIDE: 32, NARROW: 4}
# of several steps there are many, however few the actions are
_FEWEST_SEQUENCES = 16
# enough where nothing is random: two that are the same tell that, more that none owes to rounding
_CERTAIN_SCENARIOS = {WIDE: 2, NARROW: 8}
# how far real actions are moved where that is found out, in units of the components
_SPREAD = 0.3
_FEWEST, _MOST = 128, 4096
# of the time of a decision, and at most, a call may take
_SHARE, _LONGEST_SECONDS = 0.1, 0.05
# at the first step, for later ones have shorter rollouts; and of the very first call
_USABLE_SHARE, _HOPELESS_SHARE = 1.0, 4.0
_MARGIN, _FORGETTING, _AFTER_NONE = 1.2, 0.95, 0.7
# of the time of a step as it was measured first: no step is expected to be faster
_LEAST_SHARE = 0.5
# a program with gradients takes so many times as long to compile as one without
_CLIMB_COMPILATION = 2.0
_LEGALITY_BATCH = 64


class Simulator:
    """Compiles everything that a decision needs, and knows how long it takes.

    Attributes:
      may_draw: whether the model states a draw from a law of more than one value.
      is_random: whether such a draw has changed a return, as far as is known.
    """

    def __init__(
        self, policy: Prepared, depth: int, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        """Compiles nothing yet.

        Args:
          policy: what plays after the first actions.
          depth: steps n of a candidate, at least as many as a method changes.
          clock: tells the seconds.
        """
        self.policy, self.depth = policy, depth
        self.components = Components.of(policy.planner)
        self.horizon = policy.planner.rddl.horizon
        self._clock = clock
        self._continuations = Continuations(policy.planner, policy.rollout_policy)
        self._legality = self._continuations.compile_legality()
        self._programs: dict[str, Callable[..., Any]] = {}
        self._sizes: dict[str, Size] = {}
        self._overhead: dict[str, float] = {}
        self._per_step: dict[str, float] = {}
        self._climb: Callable[..., Any] | None = None
        self._climb_seconds = (0.0, 0.0)
        self._least_climb_seconds, self._compile_seconds = 0.0, 0.0
        self.is_random = self.may_draw = has_draws(policy.problem.model)
        given = rollout_params(policy), dict(policy.policy_hyperparams)
        self._policy_arguments = jax.device_put(given)

    def prepare(
        self,
        state: Mapping[str, Any],
        seconds: float,
        until: float = math.inf,
        others: Sequence[tuple[int, Mapping[str, Any]]] = (),
    ) -> bool:
        """Compiles the calls for a decision of so many seconds, and measures them.

        Args:
          state: a state of the first step, as the environment shows it.
          seconds: of a decision.
          until: a compilation that is likely to end later, as long as the first one, is not begun.
          others: more steps and states, at which it is seen as well whether anything is random.

        Returns:
          Whether all that a decision needs is there.
        """
        longest = min(_LONGEST_SECONDS, _SHARE * seconds)
        base = self.components.flat(self.policy(0, state))
        self.legal(state, base[np.newaxis])
        rollouts, started = _FEWEST, self._clock()
        self._compile(WIDE, rollouts, state, base)
        self._compile_seconds = self._clock() - started
        if self.seconds(WIDE, 0) > _HOPELESS_SHARE * seconds:
            return False
        # what a belief has not told yet may differ later
        if self.is_random and not isinstance(state, Belief):
            self.is_random = any(self._differs(*place) for place in [(0, state), *others])
        took = self.seconds(WIDE, 0)
        wanted = int(np.clip(_FEWEST * longest / took, _FEWEST, _MOST))
        # without time to compile it again a call of another length does as well
        if (not self.is_random or took < longest / 8) and self._can_compile(2.0, until):
            rollouts = wanted
            self._compile(WIDE, rollouts, state, base)
        if self.seconds(WIDE, 0) > _USABLE_SHARE * seconds:
            return False
        if self._can_compile(1.0, until):
            self._compile(NARROW, rollouts, state, base)
        else:
            # its calls have fewer scenarios, but they are there
            self._programs[NARROW], self._sizes[NARROW] = self._programs[WIDE], self._sizes[WIDE]
            for expected in (self._overhead, self._per_step):
                expected[NARROW] = expected[WIDE]
        return True

    def prepare_climbing(self, state: Mapping[str, Any], until: float = math.inf) -> None:
        """Compiles the gradient steps and measures them, after `prepare`.

        There are none from a belief.

        Args:
          state: any state, as the environment shows it.
          until: nothing is compiled if that is likely to end later; `climb` returns None then.
        """
        if isinstance(state, Belief) or not self._can_compile(_CLIMB_COMPILATION, until):
            return
        count = _CLIMB_SCENARIOS if self.is_random else 1
        size = ClimbSize(self.climbers, count, min(self.horizon, _CLIMB_WINDOW))
        climbing = Climbing(self.policy.planner)
        self._climb = climbing.compile(size, self.components.units, _NOISE)
        candidates = np.zeros((self.climbers, self.depth, self.components.size), np.float32)
        candidates[:, 0] = self.components.flat(self.policy(0, state))
        rates = np.zeros(candidates.shape[:2], np.float32)

        def call(steps: int) -> float:
            started = self._clock()
            self._take_steps((state, 0), Ascent.from_candidates(candidates), rates, steps)
            return self._clock() - started

        call(1)
        one = float(np.median([call(1) for _ in range(3)]))
        many = call(_MEASURED_STEPS)
        self._climb_seconds = one, max(many - one, 0.1 * one) / (_MEASURED_STEPS - 1)
        self._least_climb_seconds = _LEAST_SHARE * self._climb_seconds[1]

    def climb(
        self,
        place: tuple[Mapping[str, Any], int],
        ascent: Ascent,
        rates: np.ndarray,
        seconds: float,
    ) -> Climbed | None:
        """As many gradient steps as the time is enough for, in calls; None where for none.

        Args:
          place: the state, as the environment shows it, and its step.
          ascent: of `climbers` candidates [P, k, D].
          rates: of each step of theirs [P, k], in units of the components.
          seconds: for all steps.
        """
        until, start, first_sigma, taken = self._clock() + seconds, ascent, None, 0
        while (steps := self._climbs_until(until)) > 0 and taken < _MOST_CLIMBS:
            started, taken = self._clock(), taken + steps
            ascent, sigma = self._take_steps(place, ascent, rates.astype(np.float32), steps)
            first_sigma = sigma if first_sigma is None else first_sigma
            overhead, each = self._climb_seconds
            seen = (self._clock() - started - overhead) / steps
            self._climb_seconds = overhead, max(_FORGETTING * each, seen)
        if first_sigma is None:
            return None
        reached = np.where(np.isfinite(ascent.candidates), ascent.candidates, start.candidates)
        return Climbed(ascent._replace(candidates=reached), first_sigma)

    @property
    def climbers(self) -> int:
        """Candidates that climb side by side."""
        return _CLIMBERS if self.is_random else 1

    def _can_compile(self, programs: float, until: float) -> bool:
        """Whether compiling so much, in units of the first program, is likely to end in time."""
        return self._clock() + programs * self._compile_seconds <= until

    def _climbs_until(self, until: float) -> int:
        """How many gradient steps to make in a call that is to end then, or earlier."""
        if self._climb is None:
            return 0
        overhead, each = self._climb_seconds
        left = min(until - self._clock(), _LONGEST_SECONDS + overhead)
        return int((left / _MARGIN - overhead) / each)

    def _take_steps(
        self, place: tuple[Mapping[str, Any], int], ascent: Ascent, rates: np.ndarray, steps: int
    ) -> tuple[Ascent, np.ndarray]:
        assert self._climb is not None  # `prepare_climbing` was called
        where = self._numbers(place[0]), place[1]
        key = jax.random.fold_in(jax.random.PRNGKey(place[1]), _CLIMB_STREAM)
        found = self._climb(key, self._policy_arguments, where, ascent, rates, steps)
        return jax.tree.map(np.asarray, found)

    def scenarios(self, kind: str) -> int:
        """Scenarios of one call."""
        return self._sizes[kind].scenarios

    def challengers(self, kind: str) -> int:
        """Candidates of one call, the base not counted."""
        most = _CANDIDATES[NARROW] if kind == NARROW else math.inf
        return int(min(self._sizes[kind].candidates, most)) - 1

    def seconds(self, kind: str, step: int) -> float:
        """How long a call at a step is likely to take."""
        steps = max(1, self.horizon - step)
        return _MARGIN * (self._overhead[kind] + steps * self._per_step[kind])

    def expect_less(self) -> None:
        """Lowers what calls are likely to take, since none was made for want of time.

        Else one that was slow by chance would be the last.
        """
        self._per_step = {kind: _AFTER_NONE * each for kind, each in self._per_step.items()}
        overhead, each = self._climb_seconds
        # one call of far too many steps could not be ended
        self._climb_seconds = overhead, max(_AFTER_NONE * each, self._least_climb_seconds)

    def legal(self, state: Mapping[str, Any], actions: np.ndarray) -> np.ndarray:
        """Which of the actions [M, D] are legal [M]."""
        known = self._numbers(state)
        verdicts = []
        for start in range(0, len(actions), _LEGALITY_BATCH):
            batch = actions[start : start + _LEGALITY_BATCH]
            missing = _LEGALITY_BATCH - len(batch)
            padded = np.concatenate([batch, np.repeat(batch[:1], missing, axis=0)])
            verdicts.append(
                np.asarray(self._legality(known, jax.numpy.asarray(padded)))[: len(batch)]
            )
        return np.concatenate(verdicts) if verdicts else np.zeros(0, bool)

    def gains(
        self, kind: str, state: Mapping[str, Any], step: int, candidates: np.ndarray, seed: int
    ) -> np.ndarray:
        """What candidates return more than the first of them, on common scenarios.

        Args:
          kind: of the call.
          state: as the environment shows it.
          step: its number.
          candidates: the base and at most `challengers(kind)` others [n + 1, k, D].
          seed: of the scenarios.

        Returns:
          The differences of the discounted returns to the horizon [n, N], by `paired_gains`.
        """
        size = self._sizes[kind]
        missing = size.candidates - len(candidates)
        padded = np.concatenate([candidates, np.repeat(candidates[:1], missing, axis=0)])
        started = self._clock()
        returns = self._returns(kind, state, step, padded, seed)
        self._measure(kind, step, self._clock() - started)
        steps = max(1, self.horizon - step)
        return paired_gains(returns[: len(candidates)], steps, is_certain=not self.may_draw)

    def _measure(self, kind: str, step: int, seconds: float) -> None:
        if kind not in self._per_step:
            return
        steps, known = max(1, self.horizon - step), self._per_step[kind]
        more = max(0.0, seconds - self._overhead[kind]) - steps * known
        # where few steps are left the overhead may be what is late
        self._per_step[kind] = max(_FORGETTING * known, known + more / self.horizon)

    def _compile(self, kind: str, rollouts: int, state: Mapping[str, Any], base: Any) -> None:
        self._per_step.pop(kind, None)
        size = self._sizes[kind] = self._size(kind, rollouts)
        self._programs[kind] = self._continuations.compile(size, is_rounded=kind == NARROW)
        candidates = np.zeros((1, self.depth, self.components.size), np.float32)
        candidates[0, 0] = base

        def call(step: int, seed: int) -> float:
            started = self._clock()
            self.gains(kind, state, step, candidates, seed)
            return self._clock() - started

        call(0, 0)
        last, steps = self.horizon - 1, self.horizon
        self._overhead[kind] = min(call(last, seed) for seed in range(1, 4))
        whole = float(np.median([call(0, seed) for seed in range(1, 4)]))
        self._per_step[kind] = max(0.0, whole - self._overhead[kind]) / steps

    def _size(self, kind: str, rollouts: int) -> Size:
        # where there are fewer actions more would be copies of the base, but for several steps
        different = self.components.joint_actions
        if self.depth > 1:
            different = max(_FEWEST_SEQUENCES, different)
        most = min(different, self.components.most_candidates(self.depth))
        most = max(_CANDIDATES[NARROW], most)
        count = int(min(_CANDIDATES[kind], most))
        # what returns have not shown yet the finalists' test may show
        if self.is_random or (self.may_draw and kind == NARROW):
            return Size(count, max(2, rollouts // count))
        wide = int(min(max(count, rollouts // 4), most))
        return Size(wide if kind == WIDE else count, _CERTAIN_SCENARIOS[kind])

    def _differs(self, step: int, state: Mapping[str, Any]) -> bool:
        """Whether returns differ between scenarios, after the policy's action and many others."""
        parts, random = self.components, np.random.default_rng(0)
        shape = self._sizes[WIDE].candidates, self.depth, parts.size
        candidates = _SPREAD * parts.units * random.normal(size=shape)
        for place in parts.discrete:
            candidates[:, 0, place] = random.choice(parts.values[place], size=len(candidates))
        candidates[:, 0] = np.clip(candidates[:, 0], parts.lower, parts.upper)
        # others may lead away from where the policy goes, or out of a table
        candidates[0] = 0.0
        candidates[0, 0] = parts.flat(self.policy(step, state))
        returns = self._returns(WIDE, state, step, candidates, step)
        return bool(np.any(np.ptp(np.where(np.isfinite(returns), returns, 0.0), axis=1) > 0.0))

    def _returns(
        self, kind: str, state: Mapping[str, Any], step: int, candidates: np.ndarray, seed: int
    ) -> np.ndarray:
        arguments = self._numbers(state), step, candidates.astype(np.float32)
        key = jax.random.PRNGKey(seed)
        return np.asarray(self._programs[kind](key, *self._policy_arguments, *arguments))

    def _numbers(self, state: Mapping[str, Any]) -> dict[str, np.ndarray] | HiddenRoot:
        """The state, of a belief its root, with objects as their numbers, in the model's types.

        Environments show some fluents in other types after a step than after a reset, for which
        all would be compiled again.
        """
        if isinstance(state, Belief):
            return state.root
        planner, numbers = self.policy.planner, {}
        rddl, known = planner.rddl, planner.test_compiled.init_values
        for name, value in state.items():
            array = as_numbers(rddl, name, value)
            numbers[name] = array.astype(np.asarray(known[name]).dtype)
        return numbers
