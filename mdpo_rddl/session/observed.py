"""What a run shows of how its policy plays, beside the returns."""

import contextlib
import copy
import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pyRDDLGym.core.simulator import RDDLSimulator

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.policy.agent import PolicyAgent
from mdpo_rddl.problem.episode import Policy, WatchedPolicy
from mdpo_rddl.problem.evaluation import Evaluation, difference
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.problem.played import NotPlayedError
from mdpo_rddl.problem.trajectories import Trajectories, TrajectoriesRecorder
from mdpo_rddl.session.references import (
    MOST_EPISODES,
    many_episodes,
    noop_evaluation,
    random_evaluation,
    recorded,
)
from mdpo_rddl.session.report.page.record import write_play
from mdpo_rddl.session.report.summary import return_figures
from mdpo_rddl.session.requests import EvaluationTerms
from mdpo_rddl.simulator.evaluation import SideBySide, evaluate_side_by_side
from mdpo_rddl.simulator.simulator import Simulator

logger = logging.getLogger(__name__)

# seconds: with longer ones nothing is played only to be shown
_LONGEST_EPISODE = 2.0
# a played value that asks for a bound, and how much further one looks for that bound
_HUGE, _FURTHER = 1e6, 1e3
_INTS = -(2**31), 2**31 - 1
_LARGEST = float(np.finfo(np.float32).max)
_NEAR_LARGEST = 1e-8 * _LARGEST
_OF_A_REFERENCE = ("mean_return", "std_return", "ci95", "returns", "steps", "illegal_actions")
# of the simulator's trajectories
_MOST_NUMBERS = 1_000_000
_NAMES = {"noop": "the no-op", "random": "random actions"}


class Observed:
    """Keeps the trajectories and the decision times of the policy that is played last.

    Attributes:
      recorder: of its episodes.
      episodes: how many of them were played to their ends.
    """

    def __init__(self, terms: EvaluationTerms, longest: float = _LONGEST_EPISODE) -> None:
        """Keeps nothing yet.

        Args:
          terms: how policies are evaluated.
          longest: seconds that an episode of the policy's may take on average for more to be played
            only to be shown.
        """
        self._terms, self._longest = terms, longest
        self._seconds: list[float] = []
        self._began = self._ended = 0.0
        self.recorder = TrajectoriesRecorder(terms.problem.model, terms.episodes)
        self.episodes = 0
        self._simulated: Trajectories | None = None
        self._noop: Trajectories | None = None

    def watch(self, policy: Policy) -> Policy:
        """The same policy, whose decisions are timed; what was kept of another one is forgotten."""
        self._seconds, self._began, self._simulated = [], time.perf_counter(), None
        seconds = self._seconds
        self.recorder = TrajectoriesRecorder(self._terms.problem.model, self._terms.episodes)

        def watched(step: int, state: Any) -> Any:
            began = time.perf_counter()
            action = policy(step, state)
            self._ended = time.perf_counter()
            seconds.append(self._ended - began)
            return action

        return WatchedPolicy(policy, watched)

    def play_side_by_side(self, policy: PolicyAgent) -> None:
        """Plays many more episodes, on the simulator, for what is drawn of the trajectories.

        What was kept of the evaluation's stays where that takes too long or cannot be.

        Args:
          policy: whose play is kept.
        """
        replicated, simulator, recorder = policy.replicated(), self._simulator, self._many()
        if replicated is None or simulator is None:
            return

        def play(count: int) -> SideBySide:
            return evaluate_side_by_side(simulator, replicated, count, self._terms.seed, keep=True)

        try:
            played = many_episodes(play, recorder.kept)
        except NotPlayedError as error:  # the evaluation has met no such episode
            logger.warning("trajectories: %s", one_line_cause(error))
            return
        if len(played.evaluation.returns) > self._terms.episodes:
            self._simulated = recorded(played, recorder)

    @cached_property
    def _simulator(self) -> Simulator | None:
        """Of the problem; None if there is something that it does not know, or no state."""
        try:
            found = Simulator(self._terms.problem)
        except InputError as error:
            logger.info("no simulator: %s", one_line_cause(error))
            return None
        return found if found.observed else None

    def _many(self) -> TrajectoriesRecorder:
        """A recorder of many episodes."""
        return TrajectoriesRecorder(self._terms.problem.model, MOST_EPISODES, _MOST_NUMBERS)

    @contextlib.contextmanager
    def replaced(self) -> Iterator["Observed"]:
        """Keeps another policy's play, which replaces what is kept here if the block ends well."""
        other = copy.copy(self)  # whose lists and recorder are replaced, not changed
        yield other
        vars(self).update(vars(other))

    def figures(self, returns: Sequence[float | None]) -> dict[str, Any]:
        """Plays the no-op and random actions; JSON of their returns and of the decision times.

        Also how many episodes of the simulator the trajectories are of; None if they are those of
        the evaluation.

        Args:
          returns: of the evaluation, None where one is not finite.
        """
        self._warn_of_exploits()
        references = dict.fromkeys(_NAMES) | self._references(np.array(returns, float))
        simulated = None if self._simulated is None else len(self._simulated.rewards)
        return {
            "references": references,
            "decision_times": self._decision_times(),
            "simulated_episodes": simulated,
        }

    def _references(self, returns: np.ndarray) -> dict[str, Any]:
        simulator = self._simulator
        if simulator is None or not self.is_quick:
            return {}

        def noop() -> Evaluation:
            found, self._noop = noop_evaluation(simulator, self._terms, self._many())
            return found

        plays = {"noop": noop, "random": lambda: random_evaluation(simulator, self._terms)}
        return {name: _reference(name, play, returns) for name, play in plays.items()}

    @property
    def is_quick(self) -> bool:
        """Whether episodes of the policy were so quick that more may be played to be shown."""
        return 0.0 <= self._ended - self._began <= self._longest * self.episodes

    def write(self, folder: Path) -> None:
        """Writes the trajectories and the decision times."""
        own = self.recorder.result() if self._simulated is None else self._simulated
        plays = {"policy": own}
        if self._noop is not None:  # it was not played where an episode takes too long
            plays["noop"] = self._noop
        plays = {name: play for name, play in plays.items() if len(play.rewards)}
        write_play(folder, plays, np.array(self._seconds))

    def _warn_of_exploits(self) -> None:
        play = self.recorder.result()
        played = {name: values for (kind, name), values in play.values.items() if kind == "action"}
        largest = np.max(np.abs(np.nansum(play.rewards, axis=1)), initial=0.0)
        warn_of_exploits(self._terms.problem, played, float(largest))

    def _decision_times(self) -> dict[str, float] | None:
        if not self._seconds:
            return None
        seconds = np.array(self._seconds)
        return {
            "mean": float(seconds.mean()),
            "p99": float(np.quantile(seconds, 0.99)),
            "max": float(seconds.max()),
        }


def warn_of(problem: Problem) -> None:
    """Says what in a problem's files has no effect, or hardly the one that was meant."""
    for warning in problem.warnings:
        logger.warning("%s", warning)


def warn_of_exploits(problem: Problem, played: Mapping[str, Any], total: float) -> None:
    """Warns where an action that no precondition bounds is played at huge values.

    Args:
      problem: that is played.
      played: per action fluent values of any shape; NaN where nothing was played.
      total: the largest return.
    """
    sampler = make_environment(problem).sampler
    sampler.reset()
    for name, values in played.items():
        if problem.model.action_ranges.get(name) not in ("real", "int"):
            continue
        known = np.asarray(values, float)
        known = known[~np.isnan(known)]
        for most, word in ((known.max(initial=0.0), "<="), (known.min(initial=0.0), ">=")):
            if abs(most) >= _HUGE and _is_legal(sampler, name, _FURTHER * most):
                logger.warning(
                    "the action %s is played at %.3g, and no precondition bounds it: unless that "
                    "is meant, bound it in action-preconditions, as by %s %s ...",
                    *(name, most, name, word),
                )
    if not abs(total) < _NEAR_LARGEST:
        logger.warning(
            "a return of %.3g is near the largest number of the compiled model, %.3g: nothing "
            "in the model bounds it",
            *(total, _LARGEST),
        )


def _is_legal(sampler: RDDLSimulator, name: str, value: float) -> bool:
    """Whether all of an action's components may be so large at the start, the others as default."""
    default = np.asarray(sampler.noop_actions[name])
    is_int = default.dtype.kind in "iu"
    wanted = np.clip(value, *_INTS) if is_int else value
    actions = {**sampler.noop_actions, name: np.full_like(default, wanted)}
    try:
        return bool(sampler.check_action_preconditions(actions, silent=True))
    except Exception:  # the environment's, of values that nobody has played
        return False


def _reference(
    name: str, play: Callable[[], Evaluation], returns: np.ndarray
) -> dict[str, Any] | None:
    """The figures of a reference; a warning where it returns more than the policy."""
    try:
        found = play()
    except Exception as error:  # the environment's, which must not cost the run
        logger.warning("a reference: %s: %s", type(error).__name__, one_line_cause(error))
        return None
    gain = difference(returns, found.returns)
    if gain is not None and gain[1] < 0.0:
        mean, count = np.mean(returns), len(found.returns)
        told = f"{found.mean:z,.2f} in {count:,} episodes on the simulator, the policy {mean:z,.2f}"
        logger.warning("%s returned more than the policy: %s", _NAMES[name], told)
    figures = return_figures(found)
    return {key: figures[key] for key in _OF_A_REFERENCE} | {"simulated": True}
