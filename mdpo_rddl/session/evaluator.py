"""Plays the policies of one session on the exact environment."""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mdpo_rddl.problem.episode import Episode, WatchedPolicy
from mdpo_rddl.problem.evaluation import Evaluation, Policy, begun_episodes, evaluation_of
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.played import NotPlayedError, PlayedSimulator
from mdpo_rddl.session.observed import Observed
from mdpo_rddl.session.requests import EvaluationTerms, Reporter


class _TimeIsOver(Exception):  # noqa: N818, it is no error
    """The evaluation has taken as long as it may."""


@dataclass
class Evaluator:
    """Evaluates policies on the given terms, and reports each episode.

    Attributes:
      seconds: after which an evaluation ends, in whatever episode.
      begun: the episodes of the policy that was played last, also after an error in the last one.
      ended: how many of them were played to their ends.
      was_stopped: whether somebody has stopped one of its evaluations.
    """

    terms: EvaluationTerms
    reporter: Reporter
    seconds: float = math.inf
    begun: list[Episode] = field(default_factory=list, init=False)
    ended: int = field(default=0, init=False)
    was_stopped: bool = field(default=False, init=False)

    def run(self, policy: Policy, observed: Observed | None = None) -> Evaluation:
        """Plays a policy.

        Args:
          policy: what is played.
          observed: keeps how it plays.

        Raises:
          NotPlayedError: naming the files, if the environment fails.
        """
        self.begun, self.ended = [], 0
        terms, problem = self.terms, self.terms.problem
        until = time.monotonic() + self.seconds
        env = make_environment(problem, backend=PlayedSimulator)
        recorder = None
        if observed is not None:
            policy = observed.watch(policy)
            recorder = observed.recorder
        if math.isfinite(until):
            policy = _until(policy, until)
        try:
            for episode, state in begun_episodes(env, policy, terms.episodes, terms.seed, recorder):
                self.begun.append(episode)
                episode.play(state)
                self.ended += 1
                self.reporter.episode(self.ended, terms.episodes)
        except NotPlayedError as error:
            raise NotPlayedError(f"{self.place}: {error}") from error
        except _TimeIsOver:
            pass
        except KeyboardInterrupt:
            self.was_stopped = True
            raise
        finally:
            if observed is not None:
                observed.episodes = self.ended
        return self.so_far()

    def so_far(self) -> Evaluation:
        """What has come of the episodes that have ended."""
        return evaluation_of(self.begun[: self.ended])

    @property
    def place(self) -> str:
        """The problem's files, and the episode that is played."""
        problem = self.terms.problem
        return f"{problem.domain_path}, {problem.instance_path}: episode {self.ended + 1}"


def _until(policy: Policy, until: float) -> Policy:
    """A policy that decides nothing any more once the time is over."""

    def decide(step: int, state: Mapping[str, Any]) -> Mapping[str, Any]:
        if time.monotonic() >= until:
            raise _TimeIsOver
        return policy(step, state)

    return WatchedPolicy(policy, decide)
