"""The arm that follows the gradient of many straight-line plans side by side, and crosses them."""

import logging
import math
from typing import NamedTuple

import jax
import numpy as np

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.compiling import CompilingArm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.search.crossing import Plans, crossed, parts_of
from mdpo_rddl.errors import Cancelled, note_heard
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.shooting import Climb, Shooting
from mdpo_rddl.planner.start import unit_hyperparams

logger = logging.getLogger(__name__)

SHOOTING = "shooting"
# plans side by side: fewer where they have more numbers together
_MOST_PLANS, _FEWEST_PLANS, _MOST_NUMBERS = 8, 2, 200_000
# Adam's step sizes, in units of the actions: the first plan has the largest, the fourth the
# smallest one, the fifth the largest again
_RATES = 0.008, 0.004, 0.002, 0.001
# iterations of the first phase, and how the next ones differ, until they begin again
_ITERATIONS, _LONGER, _SMALLER, _PHASES = 500, 1.5, 0.8, 10
# how far a phase's plans lie from the best one, in units: none for the first, so much for the last
_FIRST_SPREAD, _SPREAD = 0.06, 0.01
# of a call, which cannot be interrupted
_CALL_SECONDS = 0.2


class _Phase(NamedTuple):
    """What makes up a phase: how long it is, and how large its steps and its plans' spread are."""

    iterations: int
    pace: float
    spread: float

    @classmethod
    def numbered(cls, number: int) -> "_Phase":
        """The phase of a number, counted from 0."""
        place = number % _PHASES
        spread = _SPREAD if place else _FIRST_SPREAD
        return cls(round(_ITERATIONS * _LONGER**place), _SMALLER**place, spread)


class ShootingArm(CompilingArm):
    """Plans for a problem in whose return chance plays no part, all of whose actions are real.

    In each phase plans begin around the best one and climb with step sizes of their own. At its end
    each object's actions are taken from the plan in which they return most (`search/crossing.py`).
    Its policies are JaxPlan's straight-line plans.
    """

    def __init__(self, arena: Arena, usual_seconds: float = 0.0) -> None:
        """Compiles nothing yet.

        Args:
          arena: what all arms have in common.
          usual_seconds: what its program is likely to take to compile.
        """
        super().__init__(SHOOTING, arena, usual_seconds)
        self._shooting: Shooting | None = None
        self._climb: Climb | None = None
        self._best: dict[str, np.ndarray] | None = None
        self._count = _FEWEST_PLANS
        # of the phase: which it is, and its iterations so far
        self._number = self._done = 0
        self._test_seconds, self._offered = 0.0, -math.inf

    def _begin(self) -> None:
        self._start(self._compile)

    def _compile(self) -> None:
        """Makes the first iterations of a phase."""
        self._shooting = Shooting(self._planner, self._arena.plan.units)
        noop = self._shooting.noop()
        numbers = sum(plan.size for plan in noop.values())
        self._count = int(np.clip(_MOST_NUMBERS // numbers, _FEWEST_PLANS, _MOST_PLANS))
        found = self._earlier_params(self._planner)
        self._best = noop if found is None else dict(found)
        self._begin_phase()
        self._advance(1)

    @property
    def _planner(self) -> MDPOPlanner:
        return self._arena.straight_line.built.planner

    @property
    def _begun(self) -> Shooting:
        assert self._shooting is not None  # it is compiled
        return self._shooting

    def _work(self, until: float) -> None:
        """Climbs for a slice.

        Raises:
          Cancelled: if interrupted; what was found till then is offered.
        """
        if not self._is_compiled(until):
            return
        try:
            while True:
                self._climb_on(until)
                self._arena.pulse()
                is_over = self._log.iterations >= self._arena.most_iterations
                if is_over or self._clock() >= until:
                    break
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            self._offer_best()
            raise
        self._offer_best()
        self.is_exhausted = is_over

    def _climb_on(self, until: float) -> None:
        """One call, and what comes at the end of a phase."""
        started, length = self._clock(), _Phase.numbered(self._number).iterations
        tests = 1
        if self._test_seconds > 0.0:
            fitting = min(_CALL_SECONDS, until - started) / self._test_seconds
            left = (length - self._done) / self._begun.steps
            tests = max(1, min(math.ceil(left), int(fitting)))
        self._advance(tests)
        self._test_seconds = (self._clock() - started) / tests
        if self._done >= length:
            self._end_phase()

    @property
    def _rates(self) -> np.ndarray:
        rates = np.resize(_RATES, self._count)
        return rates * _Phase.numbered(self._number).pace

    def _begin_phase(self) -> None:
        """Plans around the best one, and that one itself."""
        assert self._best is not None
        random = np.random.default_rng([self._arena.seed, self._number])
        spread = _Phase.numbered(self._number).spread * np.linspace(0.0, 1.0, self._count)
        plans = {}
        for name, unit in self._begun.units.items():
            plan = self._best[name]
            noise = random.normal(size=(self._count, *plan.shape)) * np.asarray(unit)
            plans[name] = plan + np.reshape(spread, (-1, *[1] * plan.ndim)) * noise
        self._climb, self._done = self._begun.begin(plans), 0

    def _advance(self, tests: int) -> None:
        assert self._climb is not None
        climb = self._begun.climbed(self._climb, self._rates, tests)
        self._climb = jax.block_until_ready(climb)
        iterations = tests * self._begun.steps
        self._done += iterations
        self._log.iterations += iterations
        self._take(self._climb)

    def _take(self, climb: Climb) -> None:
        """Keeps the best iterate of all plans, if it is the best so far."""
        returns = np.asarray(climb.returns)
        best = int(returns.argmax())
        if returns[best] > self._estimate:
            self._estimate = float(returns[best])
            self._best = {name: np.asarray(plans[best]) for name, plans in climb.best.items()}

    def _end_phase(self) -> None:
        """Crosses the plans' best iterates, if the time reaches, and begins the next phase."""
        assert self._climb is not None
        parts = parts_of(self._planner.rddl)
        # about as many calls as parts; a test's step has a gradient besides
        needed = len(parts) * self._test_seconds / self._begun.steps
        if self._clock() + needed <= self._arena.deadline:
            plans = {name: np.asarray(values) for name, values in self._climb.best.items()}
            found, reached = crossed(plans, np.asarray(self._climb.returns), parts, self._returns)
            if reached > self._estimate:
                self._best, self._estimate = found, reached
        logger.info("shooting: %.6g after phase %d", self._estimate, self._number)
        self._number += 1
        self._begin_phase()

    def _returns(self, plans: Plans) -> np.ndarray:
        """Returns of any number of plans, as many at once as climb side by side."""
        count, returns = self._count, []
        total = len(next(iter(plans.values())))
        for start in range(0, total, count):
            places = np.minimum(np.arange(start, start + count), total - 1)
            returns.append(self._begun.returns({n: each[places] for n, each in plans.items()}))
        return np.concatenate(returns)[:total]

    def _offer_best(self) -> None:
        """Hands in the best plan, if it is a new one, with its return, which the judge would find.

        Chance plays no part, so that its test on the exact model tells that.
        """
        best, planner, arena = self._best, self._planner, self._arena
        if best is None or self._estimate <= self._offered:
            return
        self._offered = self._estimate
        self._offer(
            Candidate(
                arm=self.name,
                label=f"{self.name}, iteration {self._log.iterations:,}",
                config=arena.straight_line.config,
                planner=planner,
                params=best,
                policy_hyperparams=unit_hyperparams(planner),
                mean=self._estimate,
                error=0.0,
                returns=np.full(arena.judge.rollouts, self._estimate),
            )
        )
