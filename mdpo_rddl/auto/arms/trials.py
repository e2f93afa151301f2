"""The arm that searches by trials where the states are too many to be enumerated."""

import logging
import math
from collections.abc import Callable

import numpy as np

from mdpo_rddl.auto.arms.base import FIRST_SLICES, Arm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.auto.search.tables import action_table
from mdpo_rddl.auto.search.trials.backward import Greedy
from mdpo_rddl.auto.search.trials.explored import Explored
from mdpo_rddl.auto.search.trials.playing import Play, play, runs
from mdpo_rddl.auto.search.trials.trials import TrialSearch
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.table import Estimate
from mdpo_rddl.problem.enumeration.limits import (
    EnumerationLimits,
    NotEnumerableError,
    OutOfTimeError,
)
from mdpo_rddl.problem.enumeration.model import GroundModel
from mdpo_rddl.problem.evaluation import mean_and_error
from mdpo_rddl.problem.load import Problem

logger = logging.getLogger(__name__)

TRIALS = "trials"
# that tell a table's return; a quarter of them where that takes too long, but not fewer than some
_EPISODES, _FEWEST_EPISODES = 512, 64
# in what was not seen: which is better depends on how much of it is known from elsewhere
_TRUSTS = (0.0, 0.9)
# of a first slice: what it may take to see what was found
_CLOSING_SHARE = 0.25
# what that takes at most, in backward inductions: one for each trust, and three times the episodes
_CLOSING_INDUCTIONS = 8.0
# of the decisions: with more of them in unknown states, chance makes every episode a new one
_MOST_MISSED = 0.5
# with so many the table is of no use, which a few episodes tell
_LOST, _FEW = 0.9, 32
_NEVER_AGAIN = "most states are never seen again"
# slices without a better table, after which the arm is given up; of the error of its return, by
# which what is known must rise otherwise
_PATIENCE, _NOTICED, _ROUNDING = 3, 0.1, 1e-9


class TrialsArm(Arm):
    """Offers tables of actions, with their returns in simulated episodes of the ground model."""

    def __init__(
        self,
        problem: Problem,
        config: PlannerConfig,
        seed: int,
        clock: Clock,
        model: GroundModel,
        pulse: Callable[[], None] = lambda: None,
    ) -> None:
        """Does nothing yet.

        Args:
          problem: the parsed problem.
          config: of the race.
          seed: of everything that is drawn.
          clock: what is asked for the time.
          model: of the problem.
          pulse: called between two batches of trials.
        """
        super().__init__(TRIALS, clock)
        self._problem, self._config, self._seed = problem, config, seed
        self._model, self._pulse = model, pulse
        self._search: TrialSearch | None = None
        self._best, self._closing, self._episodes = -np.inf, 0.0, _EPISODES
        # see `progress`; it rises by what is more than rounding
        self._known = -np.inf
        self._without_gain = self._skipped = 0
        self._was_late = False

    @property
    def progress(self) -> float:
        """Value of the best policy on what was seen, where the rest is worth the no-op."""
        return self._known

    def _work(self, until: float) -> None:
        left = until - self._clock()
        closing = self._closing or _CLOSING_SHARE * left
        if left < 2.0 * closing:
            # the first ones in the rounds are shorter than others
            self._skipped += 1
            if self._skipped > FIRST_SLICES:
                self._give_up("its slices are too short")
            return
        self._skipped = 0
        try:
            if self._search is None:
                limits = self._limits(until)
                self._search = TrialSearch(self._model, limits, self._seed, self._clock)
            self._explore(self._search, until, closing)
        except OutOfTimeError as error:
            if self._was_late:
                self._give_up(f"what it needs is not made in time: {error}")
            self._was_late = True  # the second of the first slices is longer
        except NotEnumerableError as error:
            self._give_up(str(error))
        except Exception as error:  # the other arms need no ground model
            self._give_up(f"{type(error).__name__}: {one_line_cause(error)}")

    def _explore(self, search: TrialSearch, until: float, closing: float) -> None:
        """Trials, and what they have found, if there is time to see that."""
        try:
            search.work(until, self._pulse, lambda one: max(closing, _CLOSING_INDUCTIONS * one))
            self._close(search, until)
        except OutOfTimeError:
            self._closing = 2.0 * closing
            self._episodes = max(_FEWEST_EPISODES, self._episodes // 4)
            self._note_no_gain("there is too little time to see what was found")

    def _limits(self, until: float) -> EnumerationLimits:
        return EnumerationLimits(until - self._clock(), clock=self._clock)

    def _close(self, search: TrialSearch, until: float) -> None:
        """Offers what was found if it is better than before, and sees whether to go on.

        Args:
          search: what has explored.
          until: when it has to be over.

        Raises:
          OutOfTimeError: if it is not over then.
        """
        started, explored = self._clock(), search.explored
        before = self._best
        result = self._found(search, self._limits(until).check_time)
        if result is None:
            self._give_up(_NEVER_AGAIN)
            return
        best, played, missed, known = result
        self._closing = self._clock() - started
        mean, error = mean_and_error(played.returns)
        if mean > self._best:
            self._best = mean
            estimate = Estimate(mean, error, self._episodes, played.missed, explored.size)
            self._offer_table(explored, best, estimate)
        self._log.iterations = search.batches
        self._log.details = {"states": explored.size, "missed": round(missed, 4)}
        if is_known_better := known > self._known + self._noticed(error):
            self._known = known
        if self._best > before or is_known_better:
            self._without_gain = 0
        else:
            self._note_no_gain("it gains nothing more")
        if search.is_full:
            self._give_up("no room for more states")
        elif missed > _MOST_MISSED:
            self._give_up(_NEVER_AGAIN)

    def _noticed(self, error: float) -> float:
        """What the known value must rise by, given the error of the return."""
        if not math.isfinite(self._known):
            return 0.0
        rounding = _ROUNDING * (1.0 + abs(self._known))
        return max(rounding, _NOTICED * error if math.isfinite(error) else 0.0)

    def _is_lost(self, search: TrialSearch, greedy: Greedy, check_time: Callable[[], None]) -> bool:
        """Whether a few episodes show that hardly a state is ever seen again.

        They do not before trials have come to their end, nor once a table was found.
        """
        if np.isfinite(self._best) or not search.has_ended:
            return False
        played = play(search.explored, greedy, _FEW, self._seed, check_time=check_time)
        self._log.details = {"states": search.explored.size, "missed": round(played.missed, 4)}
        return played.missed > _LOST

    def _found(
        self, search: TrialSearch, check_time: Callable[[], None]
    ) -> tuple[Greedy, Play, float, float] | None:
        """The best policy, fresh episodes, the share of unknown states in them, and what is known.

        None if hardly a state is ever seen again.
        """
        found: list[tuple[float, Greedy]] = []
        episodes = self._episodes
        missed, known = 1.0, -np.inf
        for trust in _TRUSTS:
            greedy = search.found(trust, check_time)
            if trust == 0.0:
                known = greedy.value
            if not found and self._is_lost(search, greedy, check_time):
                return None
            played = play(search.explored, greedy, episodes, self._seed, False, check_time)
            missed = min(missed, played.missed)
            found.append((mean_and_error(played.returns)[0], greedy))
        _, best = max(found, key=lambda pair: pair[0])
        # the episodes it was chosen by were kind to it
        fresh = play(search.explored, best, episodes, self._seed, True, check_time)
        return best, fresh, missed, known

    def _offer_table(self, explored: Explored, greedy: Greedy, estimate: Estimate) -> None:
        states, changes = explored.index.states, runs(explored, greedy)
        table = action_table(self._problem, self._model, explored.merges, states, changes)
        candidate = Candidate(
            arm=self.name,
            label=TRIALS,
            config=self._config,
            planner=None,
            params=None,
            table=(table, estimate),
            mean=estimate.value,
            error=estimate.error,
        )
        self._offer(candidate)

    def _note_no_gain(self, cause: str) -> None:
        self._without_gain += 1
        if self._without_gain >= _PATIENCE:
            self._give_up(cause)

    def _give_up(self, cause: str) -> None:
        logger.info("no more trials: %s", cause)
        self._log.details = {**self._log.details, "cause": cause}
        self.is_exhausted = True
