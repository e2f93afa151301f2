"""A policy as an agent of pyRDDLGym: it counts the steps and takes either kind of environment."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from pyRDDLGym import RDDLEnv
from pyRDDLGym.core.policy import BaseAgent

from mdpo_rddl.errors import InputError
from mdpo_rddl.policy.file import AnySaved, problem_played
from mdpo_rddl.problem.episode import tell_played
from mdpo_rddl.problem.evaluation import Evaluation, evaluate
from mdpo_rddl.problem.feasibility import has_equality
from mdpo_rddl.problem.functions import FunctionsGiven
from mdpo_rddl.problem.grounding import (
    grounded,
    is_grounded,
    lifted,
    require_batch,
    require_observation,
)
from mdpo_rddl.problem.legal_moves import LegalMoves
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.simulator.evaluation import Replicated, SideBySide, evaluate_side_by_side
from mdpo_rddl.simulator.simulator import Simulator

_EPISODES = 50


@dataclass
class _Decisions:
    """What an agent has decided since its episode began, and what was illegal ever."""

    step: int = 0
    illegal: int = 0
    fallback: int = 0


class PolicyAgent(BaseAgent):
    """Makes an agent of whatever maps a step and an observation to an action.

    A subclass has a `problem` and is called with a step and the observation of a vectorized
    environment. It may be frozen: what changes while the agent plays lies in objects of its own.
    """

    use_tensor_obs = True

    if TYPE_CHECKING:

        @property
        def problem(self) -> Problem:
            """What is played."""

        def to_saved(self) -> AnySaved:
            """As a file holds it."""

    @abstractmethod
    def __call__(self, step: int, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """The action tensor per fluent at a step, for an observation per fluent."""

    def __reduce__(self) -> Any:
        """Pickled as what `save` writes; whoever unpickles it compiles what plays it."""
        own = self.problem.functions
        if own is not None and own.path is None:
            raise InputError(
                "the problem's Python functions are from no file, so that its policy cannot be "
                "pickled: save it, and load it with load_policy(path, functions=...)"
            )
        functions = None if own is None or own.path is None else own.path.resolve()
        return _unpickled, (type(self), self.to_saved(), functions)

    def __copy__(self) -> "PolicyAgent":
        other = object.__new__(type(self))
        other.__dict__.update(vars(self))
        return other

    def reset(self) -> None:
        """Begins an episode."""
        self._decisions.step = 0
        _ = self._moves  # made before there is a decision to wait for

    def sample_action(self, state: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """The next action of the episode, made legal where the policy's is not.

        Args:
          state: what the environment has shown: per fluent an array, or per ground fluent a
            scalar. None stands for what the environment shows first.

        Returns:
          Per action fluent an array, or per ground action fluent a scalar, as the state was.

        Raises:
          InputError: if ground fluents are unknown or missing.
        """
        decisions, model = self._decisions, self.problem.model
        if state is not None:
            require_observation(model, state)
        step = min(decisions.step, self.problem.horizon - 1)
        # counted first: whatever interrupts a decision, the environment goes on
        decisions.step += 1
        if state is None:
            state = make_environment(self.problem).reset(seed=0)[0]
        ground = is_grounded(model, state)
        observation = lifted(model, state) if ground else state
        verdict = self._moves.rule(self(step, observation), observation)
        decisions.illegal += verdict.illegal
        decisions.fallback += verdict.fallback
        tell_played(self, verdict.actions)
        return grounded(model, verdict.actions) if ground else verdict.actions

    def batch(self, step: int, observations: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """The actions for many observations of one step.

        Args:
          step: number of decisions before.
          observations: per fluent its values [batch, *shape].

        Returns:
          Per action fluent [batch, *shape].
        """
        count = require_batch(self.problem.model, step, observations)
        actions = [
            self(step, {name: values[each] for name, values in observations.items()})
            for each in range(count)
        ]
        return {name: np.stack([np.asarray(a[name]) for a in actions]) for name in actions[0]}

    def replicated(self) -> Replicated | None:
        """What decides for many episodes at once; None if it decides for one after the other."""
        return None

    def side_by_side(self, episodes: int, seed: int, keep: bool = False) -> SideBySide | None:
        """Plays episodes side by side on the simulator (`mdpo_rddl.simulator`).

        Args:
          episodes: how many.
          seed: of all their draws.
          keep: whether states, actions and rewards are kept.

        Returns:
          What they came to; None where the policy decides for one episode after the other, the
          simulator does not have what the problem's expressions call, or there is no state.

        Raises:
          NotPlayedError: if the environment would have raised an error in an episode.
        """
        replicated, model = self.replicated(), self._exact_model
        if replicated is None or model is None or not model.observed:
            return None
        return evaluate_side_by_side(model, replicated, episodes, seed, keep)

    @cached_property
    def _exact_model(self) -> Simulator | None:
        try:
            return Simulator(self.problem)
        except InputError:
            return None

    def evaluate(
        self,
        env: RDDLEnv | None = None,
        episodes: int | None = None,
        verbose: bool = False,
        render: bool = False,
        seed: int | None = None,
    ) -> Evaluation:
        """Plays the policy on the exact model.

        Args:
          env: played as pyRDDLGym's agents play it, vectorized or not, with the seed for the first
            episode only. If None, all episodes are played side by side on the simulator, whose
            draws are others than those of `mdpo-plan`'s evaluation (`mdpo_rddl.evaluate`). A
            policy that thinks or votes plays them one by one, as there.
          episodes: how many; if None 50, or 1 in an environment that is given, as there.
          verbose: have pyRDDLGym print each step of an environment that is given.
          render: have it draw them.
          seed: of the episodes; if None 0, or none in an environment that is given.

        Raises:
          InputError: if `verbose` or `render` is set without an environment, there is to be no
            episode, or the seed is negative; or if the environment would have raised an error in
            an episode on the simulator.
        """
        usual = _EPISODES if env is None else 1
        count = usual if episodes is None else episodes
        if count < 1:
            raise InputError(f"episodes must be at least 1, got {count}")
        if seed is not None and seed < 0:
            raise InputError(f"seed must be at least 0, got {seed}")
        if env is not None:
            return self._evaluate_in(env, count, verbose, render, seed)
        if verbose or render:
            raise InputError("verbose and render need an environment: give one as env")
        played = self.side_by_side(count, seed or 0)
        if played is not None:
            return played.evaluation
        return evaluate(make_environment(self.problem), self, count, seed or 0)

    def _evaluate_in(
        self, env: RDDLEnv, episodes: int, verbose: bool, render: bool, seed: int | None
    ) -> Evaluation:
        witness, before = _Witness(env), self._decisions
        illegal, fallback = before.illegal, before.fallback
        super().evaluate(witness, episodes, verbose, render, seed)
        return Evaluation(
            returns=np.array(witness.returns),
            lengths=np.array(witness.lengths),
            illegal_actions=self._decisions.illegal - illegal,
            fallback_actions=self._decisions.fallback - fallback,
        )

    def _exact(
        self, actions: Mapping[str, Any], observation: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        """The actions, in 64 bits where an equality asks for that."""
        return self._moves.rounded(actions, observation) if self._is_exact else actions

    @cached_property
    def _is_exact(self) -> bool:
        return has_equality(self.problem.model)

    @cached_property
    def _decisions(self) -> _Decisions:
        return _Decisions()

    @cached_property
    def _moves(self) -> LegalMoves:
        return LegalMoves(self.problem)


def _unpickled(kind: Any, saved: Any, functions: FunctionsGiven) -> Any:
    from mdpo_rddl.machine.jax_setup import kept_tables

    problem = saved.source.load(kept_tables(), functions)
    return kind.from_saved(saved, problem_played(saved, problem), "a pickle")


@dataclass
class _Witness:
    """An environment that keeps account of the episodes played in it."""

    env: RDDLEnv
    returns: list[float] = field(default_factory=list)
    lengths: list[int] = field(default_factory=list)
    # the agent takes either kind
    vectorized: bool = PolicyAgent.use_tensor_obs

    def __getattr__(self, name: str) -> Any:
        return getattr(self.env, name)

    def reset(self, seed: int | None = None) -> Any:
        """Begins an episode."""
        self.returns.append(0.0)
        self.lengths.append(0)
        return self.env.reset(seed=seed)

    def step(self, action: Mapping[str, Any]) -> Any:
        """Plays a step."""
        result = self.env.step(action)
        self.returns[-1] += float(result[1]) * self.env.discount ** self.lengths[-1]
        self.lengths[-1] += 1
        return result
