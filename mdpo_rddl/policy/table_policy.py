"""A policy that looks its action up by step and state."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.html import html_table
from mdpo_rddl.policy.agent import PolicyAgent
from mdpo_rddl.policy.file import (
    SavedTable,
    problem_identity,
    require_same_problem,
)
from mdpo_rddl.policy.plannerless import PlannerlessPolicy, numbers_of
from mdpo_rddl.policy.table import ActionTable, Claim, Optimum
from mdpo_rddl.problem.enumeration.irrelevance import Merge, merged
from mdpo_rddl.problem.enumeration.packing import Packing, Place, keys
from mdpo_rddl.problem.grounding import require_batch
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.problem.source import ProblemSource


class TablePolicy(PlannerlessPolicy):
    """Plays a table; where a state is not in it, the no-op. An agent of pyRDDLGym's.

    Attributes:
      table: of actions by state and step.
      claim: what is known of its return, for the horizon that it was made for.
      made_for: that horizon.
      seed: of the run that found it.
      misses: at how many decisions the state was not in the table.
    """

    name = "table"

    def __init__(
        self,
        problem: Problem,
        table: ActionTable,
        claim: Claim,
        seed: int,
        made_for: int | None = None,
    ) -> None:
        """Makes the keys of the table's states.

        Args:
          problem: on which to play it.
          table: of actions.
          claim: what is known of its return.
          seed: of the run that found it.
          made_for: the horizon that it is for; the problem's if None.
        """
        super().__init__(problem, claim, seed)
        self.table, self.claim = table, claim
        self.made_for = problem.horizon if made_for is None else made_for
        self.misses = 0
        self._packing = Packing(tuple(Place(*map(int, place)) for place in table.places))
        self._merges = [Merge(*masks) for masks in table.merges]
        self._keys = keys(table.states)

    @classmethod
    def from_saved(cls, saved: SavedTable, problem: Problem, source: str) -> "TablePolicy":
        """Rebuilds a saved table.

        Args:
          saved: the table.
          problem: on which to play it.
          source: where the table came from, for error messages.

        Raises:
          InputError: if it was saved for another problem, or its fluents are not the problem's.
        """
        require_same_problem(saved, problem, source)
        if _fluents(saved.table) != _fluents_of(problem, saved.table.fluents):
            raise InputError(f"{source}: damaged policy file: its fluents are not the problem's")
        horizon = saved.problem.get("horizon")
        return cls(problem, saved.table, saved.claim, saved.seed, horizon)

    def to_saved(self) -> SavedTable:
        """The policy as a file holds it."""
        source = ProblemSource.of(self.problem).without_folders()
        identity = {**problem_identity(self.problem), "horizon": self.made_for}
        return SavedTable(self.table, self.claim, identity, self.seed, source)

    @property
    def optimum(self) -> Optimum | None:
        """What is proven of the policy; None if nothing is, as for another horizon."""
        return super().optimum if self._fits_horizon else None

    @property
    def _fits_horizon(self) -> bool:
        return self.made_for == self.problem.horizon

    def with_decision_seconds(self, seconds: float) -> PolicyAgent:
        """As `Policy.with_decision_seconds`; a proven optimum is played as it is.

        Raises:
          InputError: if that is no time, in seconds above 0.
        """
        from mdpo_rddl.policy.lookahead.choice import thinking_agent

        return thinking_agent(self, seconds) or self

    @property
    def kind(self) -> str:
        """A table, and of what."""
        if not isinstance(self.claim, Optimum):
            return "a table that trials have found"
        for_another = "" if self._fits_horizon else f" for horizon {self.made_for:,}"
        return f"a table of a proven optimum{for_another}"

    def __repr__(self) -> str:
        states = f"{self.claim.states:,} states"
        return f"<TablePolicy for {self.problem.label}: {self.kind}, {states}>"

    def _repr_html_(self) -> str:
        made_for = "" if self._fits_horizon else f" with horizon {self.made_for:,}"
        rows = {
            "domain, instance": f"{self.problem.domain_name}, {self.problem.instance_name}",
            "horizon": f"{self.problem.horizon:,}",
            "plan": self.kind.removeprefix("a "),
            "return" if self.optimum is None else "optimum": f"{self.claim.value:z,.6g}{made_for}",
            "states": f"{self.claim.states:,}",
            "seed": f"{self.seed}",
        }
        return html_table(f"Policy for {self.problem.label}", rows)

    def batch(self, step: int, observations: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """As `PolicyAgent.batch`, with the states looked up together."""
        require_batch(self.problem.model, step, observations)
        return self._actions(step, observations)

    def numbers(self, step: int, observations: Mapping[str, Any]) -> np.ndarray:
        """The numbers of the actions for N states of a step [N]; 0, the no-op's, if not known."""
        table, places = self.table, self._places(observations)
        is_known = places >= 0
        known = places[is_known]
        self.misses += len(places) - len(known)
        until, steps = self._until
        # the runs of a state are in order: the first one that lasts till this step, or the last
        runs = np.searchsorted(until, known * steps + min(step, steps - 1))
        numbers = np.zeros(len(places), np.int64)
        numbers[is_known] = table.action[np.minimum(runs, table.first_run[known + 1] - 1)]
        return numbers

    def values(self, step: int, observations: Mapping[str, Any]) -> np.ndarray:
        """What the best policy returns from N states of a step on [N], of a table that knows it.

        A state that is not in the table, as no policy comes to it, counts as the worst one. Nor are
        those in the table in which an episode has ended: whoever asks must tell these.
        """
        kept, places = self.table.values, self._places(observations)
        assert kept is not None
        if step >= len(kept):
            return np.zeros(len(places))
        now = kept[step].astype(float)
        return np.where(places >= 0, now[places], now.min())

    def knows(self, observation: Mapping[str, Any]) -> bool:
        """Whether a state, as the vectorized environment shows it, is in the table."""
        return bool(self._places(_alone(observation))[0] >= 0)

    def _act(self, step: int, observation: Mapping[str, Any]) -> dict[str, Any]:
        actions = self._actions(step, _alone(observation))
        return {n: v[0] if v.ndim > 1 else v[0].item() for n, v in actions.items()}

    def _actions(self, step: int, observations: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Per action fluent [N, *shape] for N states of a step; the no-op in those not known."""
        numbers = self.numbers(step, observations)
        return {name: values[numbers] for name, values in self.table.actions.items()}

    @cached_property
    def _until(self) -> tuple[np.ndarray, int]:
        """One number for the place and the last step of each run; how many steps there are."""
        table = self.table
        steps = int(table.until_step.max(initial=0)) + 1
        place = np.repeat(np.arange(len(table.states)), np.diff(table.first_run))
        return place * steps + table.until_step, steps

    def _places(self, observations: Mapping[str, Any]) -> np.ndarray:
        """The places of N states in the table [N]; -1 for one that is not there."""
        table = self.table
        count = len(next(iter(observations.values()), _NO_STATE))
        rows = [
            numbers_of(observations[name], table.objects.get(name, ())).reshape(count, -1)
            for name in table.fluents
        ]
        states = np.zeros((count, self._packing.words), np.uint64)
        is_known = np.ones(count, bool)
        for values, place in zip(
            np.concatenate([*rows, np.zeros((count, 0), np.int64)], axis=1).T,
            self._packing.places,
            strict=True,
        ):
            shifted = values + place.offset
            is_known &= shifted >> place.bits == 0
            states[:, place.word] |= shifted.astype(np.uint64) << np.uint64(place.shift)
        states = merged(states, self._merges)
        if not len(self._keys):
            return np.full(count, -1)
        places = np.minimum(np.searchsorted(self._keys, keys(states)), len(self._keys) - 1)
        is_known &= (table.states[places] == states).all(axis=1)
        return np.where(is_known, places, -1)


_NO_STATE = np.zeros(1)


def _alone(observation: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """A state as a batch of one."""
    return {name: np.asarray(values)[np.newaxis] for name, values in observation.items()}


def _fluents(table: ActionTable) -> Any:
    """What a table takes its problem to be, as `_fluents_of` says it of a problem."""
    actions = {name: (values.shape[1:], values.dtype) for name, values in table.actions.items()}
    return len(table.places), actions, dict(table.objects)


def _fluents_of(problem: Problem, names: tuple[str, ...]) -> Any:
    """Number of state values, shape and type of each action, and the names of objects."""
    rddl, sampler = problem.model, make_environment(problem).sampler
    known = {name: sampler.init_values[name] for name in rddl.state_fluents}
    size = sum(np.size(value) for value in known.values()) if set(names) == set(known) else -1
    noop = {name: np.asarray(value) for name, value in sampler.noop_actions.items()}
    actions = {name: (value.shape, value.dtype) for name, value in noop.items()}
    ranges = {name: rddl.variable_ranges[name] for name in known}
    objects = {
        name: tuple(rddl.type_to_objects[kind])
        for name, kind in ranges.items()
        if kind in rddl.type_to_objects
    }
    return size, actions, objects
