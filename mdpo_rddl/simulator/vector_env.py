"""Gymnasium's vector environment on the simulator."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.cache import grammar_tables
from mdpo_rddl.problem.load import Functions, Problem, load_problem, make_environment
from mdpo_rddl.problem.of_environment import problem_of
from mdpo_rddl.simulator.rollouts import check_names, chosen
from mdpo_rddl.simulator.simulator import Simulator, State

Arrays = dict[str, np.ndarray]


class VectorState(NamedTuple):
    """Where N episodes are.

    Attributes:
      fluents: per fluent that is no action [*shape, N], the replicas last as in `Simulator`.
      steps: how many steps each has made [N].
      over: whether its end was reported already, so that it must be reset [N].
    """

    fluents: State
    steps: np.ndarray
    over: np.ndarray

    def replicas(self, which: Any) -> "VectorState":
        """Some of the episodes: their numbers [n], also repeated ones, or a mask [N]."""
        which = np.asarray(which)
        fluents = {name: value[..., which] for name, value in self.fluents.items()}
        return VectorState(fluents, self.steps[which], self.over[which])


class RDDLVectorEnv(VectorEnv[Arrays, Mapping[str, Any], np.ndarray]):
    """Episodes of one RDDL problem, side by side; see `make_vec`.

    The spaces are those of pyRDDLGym's vectorized environment. An observation is a dictionary of
    arrays [num_envs, *shape] in the spaces' types and shapes: bools as 0 and 1, objects as their
    numbers. Actions are the same; the no-op where a fluent is missing.

    Of an episode that the horizon, a broken state invariant or an error ends, `truncated` is true;
    `terminated` where a termination condition holds. `info` has two masks [num_envs] about the
    step:

    - `illegal`: the action broke a precondition or max-nondef-actions. It is played as it is
      given, unless constraints are enforced.
    - `error`: pyRDDLGym's environment would have raised an error. The episode ends where it was
      before the step, with reward 0.

    Attributes:
      simulator: what makes the steps.
      metadata: `autoreset_mode` is the mode.
    """

    def __init__(
        self,
        simulator: Simulator,
        num_envs: int,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        enforce_action_constraints: bool = False,
        functions: Functions | None = None,
    ) -> None:
        """Takes the spaces of the problem's environment; the arguments are those of `make_vec`."""
        try:
            self._mode = AutoresetMode(autoreset_mode)
        except ValueError as error:
            known = ", ".join(mode.value for mode in AutoresetMode)
            raise InputError(f"autoreset_mode must be one of {known}") from error
        is_whole = isinstance(num_envs, (int, np.integer)) and not isinstance(num_envs, bool)
        if not is_whole or num_envs < 1:
            raise InputError(f"num_envs must be an integer above 0, got {num_envs!r}")
        self.simulator, self.num_envs = simulator, int(num_envs)
        self.metadata = {"autoreset_mode": self._mode, "render_modes": []}
        env = make_environment(simulator.problem, functions=functions)
        self.single_observation_space: Dict = env.observation_space
        self.single_action_space: Dict = env.action_space
        self.observation_space = batch_space(env.observation_space, self.num_envs)
        self.action_space = batch_space(env.action_space, self.num_envs)
        model = simulator.problem.model
        self._objects = {
            name: len(model.type_to_objects[kind])
            for name, kind in model.action_ranges.items()
            if kind in model.type_to_objects
        }
        self._enforces = enforce_action_constraints
        self._initial = simulator.initial(self.num_envs)
        # an episode that begins in a terminal state ends with a step at which nothing happens
        self._begins_ended = bool(simulator.ended(simulator.initial(1))[0])
        self._now: VectorState | None = None
        self._idle = np.zeros(self.num_envs, bool)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Arrays, dict[str, Any]]:
        """Begins all episodes anew, or those in the mask `options["reset_mask"]` [num_envs].

        Args:
          seed: of all draws from here on: the same seed and actions, the same episodes. A list has
            one for each episode, and seeds the one generator that all of them share.
          options: what else is to be known.
        """
        if seed is not None:
            self._seed(seed)
        mask = np.ones(self.num_envs, bool)
        if options is not None and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
                raise ValueError(f"reset_mask must be bools [{self.num_envs}], one of them true")
        if self._now is None and not mask.all():
            raise ResetNeeded("the first reset is one of all episodes: leave reset_mask out")
        before = self._now or self._beginning()
        self._now = self._begun(mask, before)
        self._now = self._now._replace(over=before.over & ~mask)
        return self._shown(self._now.fluents), {}

    def step(
        self, actions: Mapping[str, Any] | None
    ) -> tuple[Arrays, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Makes one step of each episode.

        Args:
          actions: per action fluent [num_envs, *shape]; the no-op where one is missing.

        Returns:
          Observations, rewards, terminated, truncated [num_envs], and `info` with its masks.

        Raises:
          InputError: if the actions are not the problem's, or of another shape.
          ResetNeeded: before the first reset, and where an episode is over that is not reset
            automatically.
        """
        if self._now is None:
            raise ResetNeeded("reset the environment before its first step")
        state, steps, over = self._now
        if self._mode is AutoresetMode.DISABLED and over.any():
            raise ResetNeeded(f"{int(over.sum())} episodes are over: reset them (reset_mask)")
        given = self._given(actions or {})
        idle = self._idle & ~over
        moves = ~(over | idle)
        illegal = moves & ~self.simulator.legal(state, given)
        after = self.simulator.step(state, given, self.np_random)
        errors = moves & (after.errors | illegal if self._enforces else after.errors)
        played = moves & ~errors
        steps = steps + played
        terminated = (played & after.terminated) | idle
        late = steps >= self.simulator.problem.horizon
        truncated = errors | (played & (after.broken | late))
        rewards = np.where(played, after.rewards, 0.0)
        info: dict[str, Any] = {"illegal": illegal, "error": errors}

        self._now = VectorState(chosen(played, after.state, state), steps, terminated | truncated)
        if over.any():  # in the mode next step
            self._now = self._begun(over, self._now)
        shown = self._shown(self._now.fluents)
        ends = self._now.over
        if self._mode is AutoresetMode.SAME_STEP and ends.any():
            info |= self._final(shown, ends, info)
            self._now = self._begun(ends, self._now)._replace(over=np.zeros_like(ends))
            shown = self._shown(self._now.fluents)
        return shown, rewards, terminated, truncated, info

    def get_state(self) -> VectorState:
        """A copy of where the episodes are, for `set_state` of this or of another environment of
        the problem. The generator of draws is no part of it."""
        if self._now is None:
            raise ResetNeeded("reset the environment before its state is asked for")
        fluents = {name: value.copy() for name, value in self._now.fluents.items()}
        return VectorState(fluents, self._now.steps.copy(), self._now.over.copy())

    def set_state(self, state: VectorState) -> Arrays:
        """Goes on from a state of one episode, in all of them, or of as many as there are here.

        Args:
          state: is copied. To go on from the third episode of another environment everywhere:
            `vec.set_state(other.get_state().replicas([2]))`.

        Returns:
          The observations [num_envs, *shape] there.

        Raises:
          InputError: if it is a state of another problem, or of another number of episodes.
        """
        if state.fluents.keys() != self._initial.keys():
            raise InputError("the state is one of another problem: its fluents are others")
        fluents = {}
        for name, begin in self._initial.items():
            value = np.asarray(state.fluents[name])
            if value.shape[:-1] != begin.shape[:-1] or value.shape[-1] not in (1, self.num_envs):
                raise InputError(
                    f"the state of {name} has the shape {value.shape}, not {begin.shape} or "
                    f"{(*begin.shape[:-1], 1)}"
                )
            fluents[name] = np.array(np.broadcast_to(value, begin.shape), begin.dtype)
        steps = np.array(np.broadcast_to(state.steps, self.num_envs))
        over = np.array(np.broadcast_to(state.over, self.num_envs))
        self._now = VectorState(fluents, steps, over)
        self._idle = self.simulator.ended(fluents) & ~over
        return self._shown(fluents)

    def _seed(self, seed: int | Sequence[int | None]) -> None:
        if isinstance(seed, (int, np.integer)):
            super().reset(seed=int(seed))
            return
        if len(seed) != self.num_envs:
            raise ValueError(f"{self.num_envs} episodes need as many seeds, not {len(seed)}")
        fresh = np.random.SeedSequence().entropy
        seeds: list[Any] = [fresh if each is None else each for each in seed]
        self.np_random = np.random.default_rng(np.random.SeedSequence(seeds))

    def _beginning(self) -> VectorState:
        nothing = np.zeros(self.num_envs, bool)
        return VectorState(self._initial, np.zeros(self.num_envs, np.int64), nothing)

    def _begun(self, mask: np.ndarray, state: VectorState) -> VectorState:
        """The episodes in a mask at their beginning, the others where they are."""
        self._idle = np.where(mask, self._begins_ended, self._idle)
        fluents = chosen(mask, self._initial, state.fluents)
        return state._replace(fluents=fluents, steps=np.where(mask, 0, state.steps))

    def _given(self, actions: Mapping[str, Any]) -> Arrays:
        """Actions as the simulator takes them, [*shape, num_envs]."""
        check_names(self.simulator, actions)
        given = {}
        for name, value in actions.items():
            array, shape = np.asarray(value), self.simulator.shapes[name]
            fits = array.shape[:1] == (self.num_envs,) and (
                array.size == self.num_envs * math.prod(shape)
            )
            if not fits:
                raise InputError(
                    f"actions {name} have the shape {array.shape}, not {(self.num_envs, *shape)}"
                )
            if name in self._objects and not ((array >= 0) & (array < self._objects[name])).all():
                most = self._objects[name] - 1
                raise InputError(f"actions {name} are numbers of objects, from 0 to {most}")
            given[name] = np.moveaxis(array.reshape(self.num_envs, *shape), 0, -1)
        return given

    def _shown(self, state: State) -> Arrays:
        """Observations [num_envs, *shape] in the spaces' types, arrays of their own."""
        shown = {}
        for name, value in self.simulator.observation(state).items():
            space = self.single_observation_space[name]
            assert isinstance(space, Box)
            rows = np.moveaxis(value, -1, 0).reshape(self.num_envs, *space.shape)
            shown[name] = np.array(rows, space.dtype, order="C")
        return shown

    def _final(self, shown: Arrays, ends: np.ndarray, info: dict[str, Any]) -> dict[str, Any]:
        """What an info says of episodes that are over and have begun anew, as Gymnasium's own."""
        observations = np.full(self.num_envs, None, dtype=object)
        for number in np.flatnonzero(ends):
            observations[number] = {name: value[number] for name, value in shown.items()}
        final = {**info, **{f"_{name}": ends for name in info}}
        return {
            "final_obs": observations,
            "_final_obs": ends,
            "final_info": final,
            "_final_info": ends,
        }


def make_vec(
    problem: Any,
    instance: Any = None,
    num_envs: int = 1,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    functions: Functions | None = None,
    enforce_action_constraints: bool = False,
) -> RDDLVectorEnv:
    """Makes a Gymnasium vector environment of a problem: its exact model, simulated on numpy.

    Args:
      problem: a name of rddlrepository or a file, each with an `instance`; the name of a shipped
        problem, a `Problem` or a pyRDDLGym environment, whose horizon is kept.
      instance: the instance's name or number, or its file.
      num_envs: how many episodes are played side by side.
      autoreset_mode: what happens once an episode is over, one of Gymnasium's modes: it begins
        anew at the next step, in the same step (its last observation is in `info["final_obs"]`),
        or when `reset` is called with `options={"reset_mask": mask}`.
      functions: external Python functions that the domain calls, by name.
      enforce_action_constraints: whether an illegal action is an error, which ends its episode
        unplayed; else it is played, and `info["illegal"]` says so.

    Raises:
      InputError: if there is no such problem, or the simulator cannot evaluate it.
    """
    if isinstance(problem, (str, Path)):
        name = None if instance is None else str(instance)
        loaded = load_problem(str(problem), name, tables=_tables(), functions=functions)
    elif instance is not None:
        kind = type(problem).__name__
        raise InputError(f"an instance does not go with a {kind}, which has one")
    elif isinstance(problem, Problem):
        loaded = problem
    else:
        loaded = problem_of(problem)
        functions = functions or getattr(problem.unwrapped.sampler, "python_functions", None)
    simulator = Simulator(loaded, functions)
    return RDDLVectorEnv(simulator, num_envs, autoreset_mode, enforce_action_constraints, functions)


def _tables() -> Path | None:
    try:
        return grammar_tables()
    except InputError:  # there is no folder to keep anything in
        return None
