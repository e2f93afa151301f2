"""What an arm is: a pair of functions, in the manner of optax, from one state to the next."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.race.budget import Budget
from mdpo_rddl.race.evaluator import Evaluator
from mdpo_rddl.race.family import Family
from mdpo_rddl.simulator.simulator import Simulator


class Candidate(NamedTuple):
    """A policy that may become the result.

    Attributes:
      arm: the name of the one that found it.
      label: what it is, for people.
      policy: plays, and can be saved.
      parents: names of the arms whose policies it was made from, the earliest first.
      uses_noise: whether it, or what it was made from, was trained with noise on the actions.
      returns: what `Evaluator.more` has given for it already, elsewhere [N].
    """

    arm: str
    label: str
    policy: AnyPolicy
    parents: tuple[str, ...] = ()
    uses_noise: bool = False
    returns: np.ndarray = np.zeros(0)


class Judged(NamedTuple):
    """A candidate and what the evaluator says of it.

    Attributes:
      candidate: the policy.
      returns: of episodes that are the same for all candidates [N]; see `Evaluator`.
    """

    candidate: Candidate
    returns: np.ndarray

    @property
    def mean(self) -> float:
        """Of the returns."""
        return float(np.mean(self.returns))


class Context(NamedTuple):
    """What all arms are given, once.

    Attributes:
      problem: the problem.
      simulator: its exact model.
      evaluator: says what a policy returns.
      budget: of the race.
      seed: of the race; an arm's random numbers come from this and its name, see `generator`.
      family: the feedback policies of this problem, in its units and scales.
      certain: whether chance plays no part: one episode shows what a policy returns.
      on_iteration: called between two iterations of whichever arm works, and at each step of
        rollouts; what it raises passes through the arm: `DeadlineError` when the time is over,
        `Cancelled`, `KeyboardInterrupt`.
      race: has another problem planned by a race; its arguments are the problem, a configuration, a
        budget, a seed, `on_judged` and `on_iteration`.
    """

    problem: Problem
    simulator: Simulator
    evaluator: Evaluator
    budget: Budget
    seed: int
    family: Family
    certain: bool
    on_iteration: Callable[[], None]
    race: Callable[..., object] | None = None

    def generator(self, arm: str, *numbers: int) -> np.random.Generator:
        """Random numbers of an arm's own."""
        return np.random.default_rng([self.seed, *arm.encode(), *numbers])


class Turn(NamedTuple):
    """What an arm is given for a slice of time.

    Attributes:
      until: when to end, by the budget's clock.
      leader: the best candidate so far.
      best_feedback: the best whose policy is of the feedback family; None before there is any.
    """

    until: float
    leader: Judged
    best_feedback: Judged | None


class State(Protocol):
    """What an arm's state says of itself; besides, it holds what the arm likes.

    Attributes:
      found: candidates of the latest step, for the evaluator, the best last.
      claim: the return that the arm promises: its own estimate, which need not be the evaluator's;
        minus infinity before there is any.
      iterations: so far.
      is_ready: whether a step could go on; False while something is compiled or solved beside.
      is_exhausted: whether another step would be of no use.
      details: for the report, as JSON can hold it.
    """

    @property
    def found(self) -> tuple[Candidate, ...]:
        """Candidates of the latest step."""

    @property
    def claim(self) -> float:
        """The return that the arm promises."""

    @property
    def iterations(self) -> int:
        """So far."""

    @property
    def is_ready(self) -> bool:
        """Whether a step could go on."""

    @property
    def is_exhausted(self) -> bool:
        """Whether another step would be of no use."""

    @property
    def details(self) -> Mapping[str, Any]:
        """For the report."""


class Arm(NamedTuple):
    """One way to find a policy.

    Attributes:
      name: for people.
      init: makes the first state, at once: what takes long begins beside it; None where the arm
        does not apply to the problem.
      step: goes on until the turn's end, at least by one iteration.
      close: ends what goes on beside; the state stays readable.
      improves: whether it begins at the best feedback policy, whoever found it.
    """

    name: str
    init: Callable[[Context], Any | None]
    step: Callable[[Context, Any, Turn], Any]
    close: Callable[[Any], None] = lambda state: None
    improves: bool = False
