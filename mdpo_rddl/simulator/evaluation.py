"""Returns of a policy in many episodes side by side, under the referee's rules."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from mdpo_rddl.problem.evaluation import Evaluation
from mdpo_rddl.problem.legality import Referee, action_box
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.played import NotPlayedError
from mdpo_rddl.problem.random_actions import DRAWS, RandomActions
from mdpo_rddl.simulator.rollouts import Trajectories, rollout
from mdpo_rddl.simulator.simulator import Simulator, State, Step

Arrays = Mapping[str, np.ndarray]


class Replicated(Protocol):
    """A policy that decides for B episodes at once."""

    def __call__(self, step: int, observation: Arrays) -> Mapping[str, Any]:
        """Per action fluent [*shape, B], for an observation per fluent [*shape, B]; episodes begin
        at step 0."""

    def were_played(self, actions: Arrays) -> None:
        """What was played at that step, per action fluent [*shape, B]."""


class NoopReplicas:
    """Plays the no-op."""

    def __call__(self, step: int, observation: Arrays) -> dict[str, np.ndarray]:
        """Nothing: every fluent is at its default."""
        return {}

    def were_played(self, actions: Arrays) -> None:
        """It remembers nothing."""


class RandomReplicas:
    """Plays random actions that are legal as far as the observation tells; see `RandomActions`."""

    def __init__(self, simulator: Simulator, rng: np.random.Generator) -> None:
        """Takes them.

        Args:
          simulator: of the problem.
          rng: draws.
        """
        self._simulator, self._rng = simulator, rng
        self._random = RandomActions(simulator.problem)

    def __call__(self, step: int, observation: Arrays) -> dict[str, np.ndarray]:
        """Per action fluent [*shape, B]."""
        count = next(iter(observation.values())).shape[-1]
        state = {**self._simulator.initial(count), **observation}
        actions = self._random.draws(count, self._rng)
        for _ in range(DRAWS - 1):
            is_legal = self._simulator.legal(state, actions)
            if is_legal.all():
                break
            again = self._random.draws(count, self._rng)
            actions = {n: np.where(is_legal, value, again[n]) for n, value in actions.items()}
        return actions

    def were_played(self, actions: Arrays) -> None:
        """It remembers nothing."""


class SideBySide(NamedTuple):
    """What many episodes came to.

    Attributes:
      evaluation: the returns.
      trajectories: states, actions and rewards by step, where they were asked for.
    """

    evaluation: Evaluation
    trajectories: Trajectories | None


def evaluate_side_by_side(
    simulator: Simulator, policy: Replicated, episodes: int, seed: int, keep: bool = False
) -> SideBySide:
    """Plays episodes of the exact model.

    An action that is not legal is replaced as `mdpo_rddl.problem.legality.Referee` does it.

    Args:
      simulator: of the problem.
      policy: decides.
      episodes: how many.
      seed: of all draws; the same seed and number of episodes give the same returns.
      keep: whether trajectories are kept.

    Raises:
      NotPlayedError: if the environment would have raised an error in an episode.
    """
    problem = simulator.problem
    refereed = _Refereed(simulator, policy)
    found = rollout(_RefereedSimulator(simulator, refereed), refereed, episodes, seed, keep=keep)
    if lost := int(found.errors.sum()):
        raise NotPlayedError(
            f"{problem.domain_path}, {problem.instance_path}: the environment fails in "
            f"{lost:,} of {episodes:,} episodes"
        )
    illegal, fallback = refereed.counts(found.lengths)
    evaluation = Evaluation(
        found.returns,
        found.lengths,
        int(illegal.sum()),
        int(fallback.sum()),
        illegal - fallback,
        tuple(refereed.unmet),
    )
    return SideBySide(evaluation, found.trajectories)


class _RefereedSimulator(Simulator):
    """Shows all of a state, which decides what is legal, and pays by the referee's verdicts."""

    def __init__(self, simulator: Simulator, refereed: "_Refereed") -> None:
        vars(self).update(vars(simulator))
        self._refereed = refereed

    def observation(self, state: State) -> dict[str, np.ndarray]:
        return dict(state)

    def step(
        self, state: State, actions: Mapping[str, Any], generator: Any, chances: Any = None
    ) -> Step:
        after = super().step(state, actions, generator, chances)
        return after._replace(rewards=self._refereed.paid(after.rewards))


class _Refereed:
    """A policy of states whose actions are legal, as long as there are legal ones."""

    def __init__(self, simulator: Simulator, policy: Replicated) -> None:
        self._simulator, self._policy = simulator, policy
        self._env = make_environment(simulator.problem)
        self._env.reset(seed=0)
        self._referee, self._box = Referee(self._env), action_box(self._env)
        self._reals = {n for n, kind in self._env.model.action_ranges.items() if kind == "real"}
        # of each block of episodes, at each step [2, B]: illegal, and replaced
        self._marks: list[list[np.ndarray]] = []
        self._worst: Any = 0.0
        self.unmet: dict[str, None] = {}

    def __call__(self, step: int, state: Arrays) -> dict[str, np.ndarray]:
        if step == 0:
            self._marks.append([])
            self._worst = 0.0
        count = next(iter(state.values())).shape[-1]
        proposed = self._policy(step, self._simulator.observation(state))
        actions = {
            name: np.array(np.broadcast_to(value, (*self._simulator.shapes[name], count)))
            for name, value in proposed.items()
        }
        is_legal = np.ones(count, bool)
        for name in self._reals & actions.keys():
            shape = self._simulator.shapes[name]
            lower, upper = (np.broadcast_to(b, shape)[..., np.newaxis] for b in self._box[name])
            actions[name] = np.clip(np.asarray(actions[name], np.float64), lower, upper)
            is_legal &= np.isfinite(actions[name]).reshape(-1, count).all(axis=0)
        is_legal &= self._simulator.legal(state, actions)
        marks = np.zeros((2, count), bool)
        if not is_legal.all():
            # of an episode that has ended nothing is played
            places = np.flatnonzero(~is_legal & ~self._simulator.ended(state))
            for place in places:
                marks[:, place] = self._replace(actions, state, int(place))
        self._marks[-1].append(marks)
        self._policy.were_played(actions)
        return actions

    def _replace(
        self, actions: dict[str, np.ndarray], state: Arrays, place: int
    ) -> tuple[bool, bool]:
        """Puts what the referee says in a replica's place: whether it was illegal, and replaced."""
        subs = self._env.sampler.subs
        for name, values in state.items():
            subs[name] = np.reshape(values[..., place], np.shape(subs[name]))
        verdict = self._referee.rule({name: v[..., place][()] for name, v in actions.items()})
        if verdict.illegal and not verdict.fallback:
            self.unmet.update(dict.fromkeys(verdict.unmet))
        for name, value in verdict.actions.items():
            if name not in actions:
                noop = self._simulator.noop[name][..., np.newaxis]
                count = next(iter(state.values())).shape[-1]
                actions[name] = np.repeat(noop, count, axis=-1)
            actions[name][..., place] = value
        return verdict.illegal, verdict.fallback

    def paid(self, rewards: np.ndarray) -> np.ndarray:
        """What the last step pays [B]: without a legal action no more than any step before it."""
        is_illegal, is_replaced = self._marks[-1][-1]
        paid = np.where(is_illegal & ~is_replaced, np.minimum(rewards, self._worst), rewards)
        self._worst = np.minimum(self._worst, paid)
        return paid

    def counts(self, lengths: np.ndarray) -> np.ndarray:
        """Of episodes so long [B], the steps [2, B] with an illegal action, and with another one in
        its place."""
        totals = list[np.ndarray]()
        for block in filter(None, self._marks):
            marks, first = np.stack(block), sum(each.shape[-1] for each in totals)
            own = lengths[first : first + marks.shape[-1]]
            is_played = np.arange(len(marks))[:, np.newaxis] < own
            totals.append((marks & is_played[:, np.newaxis]).sum(axis=0))
        return np.concatenate(totals, axis=1) if totals else np.zeros((2, len(lengths)), int)
