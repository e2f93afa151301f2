"""Actions by state and step, as a policy holds them, from those of a ground model."""

from collections.abc import Sequence

import numpy as np

from mdpo_rddl.policy.table import ActionTable
from mdpo_rddl.problem.enumeration.irrelevance import Merge
from mdpo_rddl.problem.enumeration.model import GroundModel
from mdpo_rddl.problem.enumeration.packing import keys
from mdpo_rddl.problem.load import Problem, make_environment

Run = tuple[int, np.ndarray, np.ndarray]
"""A step, states, and the action played in each up to that step."""


def action_table(
    problem: Problem,
    model: GroundModel,
    merges: Sequence[Merge],
    states: np.ndarray,
    runs: Sequence[Run],
    values: np.ndarray | None = None,
) -> ActionTable:
    """The table.

    Args:
      problem: that it is of.
      model: of the problem.
      merges: how states were joined.
      states: packed [S, words]; runs name them by their numbers.
      runs: where actions change; a state without one is left out.
      values: of the states at each step [H, S], if they are kept.
    """
    steps = np.repeat([step for step, _, _ in runs], [len(some) for _, some, _ in runs])
    played_in, action = np.zeros((2, 0), np.int64)
    if runs:
        played_in = np.concatenate([some for _, some, _ in runs])
        action = np.concatenate([played for _, _, played in runs])
    used = np.unique(played_in)
    order = used[np.argsort(keys(states[used]))]
    rank = np.zeros(len(states), np.int64)
    rank[order] = np.arange(len(order))
    sequence = np.lexsort((steps, rank[played_in]))
    counts = np.bincount(rank[played_in], minlength=len(order))
    decided = int(steps.max(initial=-1)) + 1
    names = [name for name, _ in model.variables]
    return ActionTable(
        merges=np.array(merges, np.uint64).reshape(len(merges), 3, states.shape[1]),
        places=np.array(model.packing.places, np.int64).reshape(-1, 4),
        states=states[order],
        first_run=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        until_step=steps[sequence].astype(np.int32),
        action=action[sequence].astype(np.int32),
        actions=_action_values(problem, model),
        fluents=tuple(dict.fromkeys(names)),
        objects=_object_names(problem, names),
        values=None if values is None else np.ascontiguousarray(values[:decided, order]),
    )


def _action_values(problem: Problem, model: GroundModel) -> dict[str, np.ndarray]:
    """Per action fluent its values in every joint action [A, *shape]."""
    noop = make_environment(problem).sampler.noop_actions
    found = {}
    for name, default in noop.items():
        default = np.asarray(default)
        values = np.repeat(default[np.newaxis], len(model.actions), axis=0)
        for number, rules in enumerate(model.actions):
            for (fluent, place), value in rules.assignment.items():
                if fluent == name:
                    values[(number, *place)] = value
        found[name] = values
    return found


def _object_names(problem: Problem, names: list[str]) -> dict[str, tuple[str, ...]]:
    rddl = problem.model
    return {
        name: tuple(rddl.type_to_objects[rddl.variable_ranges[name]])
        for name in dict.fromkeys(names)
        if rddl.variable_ranges[name] in rddl.type_to_objects
    }
