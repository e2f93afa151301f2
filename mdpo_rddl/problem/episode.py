"""One episode on the exact environment, under a referee's rules."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, runtime_checkable

from pyRDDLGym import RDDLEnv

Policy = Callable[[int, Mapping[str, Any]], Mapping[str, Any]]
"""(step, observation per fluent) -> action tensor per fluent."""


class Verdict(NamedTuple):
    """What to play.

    Attributes:
      actions: per action fluent, the tensor to play.
      illegal: whether the proposal broke a rule.
      fallback: whether `actions` is a legal action in its place.
      unmet: where none was found, the preconditions that stand in the way, as RDDL.
    """

    actions: dict[str, Any]
    illegal: bool
    fallback: bool = False
    unmet: tuple[str, ...] = ()


class EpisodeReferee(Protocol):
    """Rules on actions in the current state of one environment."""

    def rule(self, proposal: Mapping[str, Any]) -> Verdict:
        """What to play; what it raises ends the episode."""


@runtime_checkable
class Informed(Protocol):
    """A policy that is told what is played, which may be another action than its own."""

    def was_played(self, actions: Mapping[str, Any]) -> None:
        """What was played at the step that it decided last, per action fluent."""


def tell_played(policy: object, actions: Mapping[str, Any]) -> None:
    """Tells a policy what is played, if it is one that is to be told."""
    if isinstance(policy, Informed):
        policy.was_played(actions)


@dataclass(frozen=True)
class WatchedPolicy:
    """A policy around whose decisions something is done; it is told what is played all the same.

    Attributes:
      policy: the policy.
      decide: asks it.
    """

    policy: Policy
    decide: Policy

    def __call__(self, step: int, state: Mapping[str, Any]) -> Mapping[str, Any]:
        """The action at a step."""
        return self.decide(step, state)

    def was_played(self, actions: Mapping[str, Any]) -> None:
        """What was played at the step that it decided last, per action fluent."""
        tell_played(self.policy, actions)


class Recorder(Protocol):
    """Who keeps what happens in an episode."""

    def add(self, state: Mapping[str, Any], actions: Mapping[str, Any], reward: float) -> None:
        """One step: what was observed before it, what was played, what it paid."""


class EpisodesRecorder(Protocol):
    """Who keeps what happens in several episodes, one after the other."""

    def begin(self) -> Recorder | None:
        """The recorder of the next episode; None if it is not kept."""


@dataclass
class Episode:
    """An episode and what has come of it so far, also after an error in it.

    Attributes:
      env: a vectorized environment.
      policy: maps step and observation to an action.
      referee: rules on each action before it is played.
      recorder: keeps each step, if there is one.
      total: discounted return.
      steps: number of steps.
      illegal: steps at which the policy's action broke a rule.
      fallback: how many of them played a legal action instead; the others pay no more than the
        legal ones before them, and nothing at best.
      unmet: preconditions that stood in the way of any legal action, as RDDL.
    """

    env: RDDLEnv
    policy: Policy
    referee: EpisodeReferee
    recorder: Recorder | None = None
    total: float = field(default=0.0, init=False)
    steps: int = field(default=0, init=False)
    illegal: int = field(default=0, init=False)
    fallback: int = field(default=0, init=False)
    unmet: tuple[str, ...] = field(default=(), init=False)

    def play(self, state: Mapping[str, Any]) -> None:
        """Plays to the horizon, a termination condition or a violated state invariant.

        Args:
          state: what the environment showed when it was reset.
        """
        discount, done, worst = 1.0, self.env.done, 0.0
        while not done:
            verdict = self.referee.rule(self.policy(self.steps, state))
            self.illegal += verdict.illegal
            self.fallback += verdict.fallback
            tell_played(self.policy, verdict.actions)
            following, reward, terminated, truncated, _ = self.env.step(verdict.actions)
            paid = float(reward)
            if verdict.illegal and not verdict.fallback:
                self.unmet = self.unmet or verdict.unmet
                paid = min(paid, worst)
            worst = min(paid, worst)
            if self.recorder is not None:
                self.recorder.add(state, verdict.actions, paid)
            self.total += discount * paid
            discount *= self.env.discount
            self.steps += 1
            state, done = following, terminated or truncated
