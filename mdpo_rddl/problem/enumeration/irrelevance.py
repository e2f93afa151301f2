"""States that differ only in what no longer matters, taken as one.

Once a bool has a value that it keeps for ever, other variables may have no way left to reach
the rewards, the preconditions or the end of the episode. Their bits are cleared then. Ints stay as
they are: cleared bits would be a value from which the next one may not fit.
"""

from typing import NamedTuple

import numpy as np

from mdpo_rddl.problem.enumeration.graph import Kind
from mdpo_rddl.problem.enumeration.joint import nodes_of
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import GroundModel

# nodes of all laws times bools, with which the time to find merges grows, to seconds for so many.
# The clock must not decide: a search that goes on in another process has to join the same states.
_MOST_WORK = 1_000_000


class Merge(NamedTuple):
    """Where the bits `mask` of `word` are `value`, only the bits `keep` [words] matter."""

    word: int
    mask: int
    value: int
    keep: np.ndarray


def find_merges(model: GroundModel, limits: EnumerationLimits) -> list[Merge]:
    """The merges that one kept bool allows, for each bool and each of its values.

    There are none where finding them would take too long.
    """
    found: list[Merge] = []
    nodes = {node for action in model.actions for node in action.nodes()}
    if len(model.graph.needed(nodes)) * sum(model.is_bool) > _MOST_WORK:
        return found
    for number, is_bool in enumerate(model.is_bool):
        for value in (False, True) if is_bool else ():
            limits.check_time()
            if not _is_kept(model, number, value):
                continue
            relevant = _relevant(model, number, value)
            if len(relevant) < len(model.variables):
                found.append(_merge(model, number, value, relevant))
    return found


def merged(states: np.ndarray, merges: list[Merge]) -> np.ndarray:
    """States [N, words] without what does not matter."""
    for word, mask, value, keep in merges:
        applies = (states[:, word] & np.uint64(mask)) == np.uint64(value)
        if applies.any():
            states = np.where(applies[:, np.newaxis], states & keep, states)
    return states


def _is_kept(model: GroundModel, number: int, value: bool) -> bool:
    """Whether a bool keeps a value, whatever is done."""
    if any(number in group for group in model.groups):
        return False  # it may well be, but its law is not one of its own
    leaf, constant = model.leaf(number), model.graph.constant(value)
    nodes = {action.laws[number][0].value for action in model.actions}
    new = model.graph.substitute(nodes, {leaf: constant})
    return all(model.graph.is_constant(node) and model.graph.values[node] == value for node in new)


def _relevant(model: GroundModel, number: int, value: bool) -> set[int]:
    """The variables that still matter, the bool itself among them."""
    graph = model.graph
    leaves = {model.leaf(each): each for each in range(len(model.variables))}
    replaced = {model.leaf(number): graph.constant(value)}

    def reads(nodes: set[int]) -> set[int]:
        new = graph.substitute(nodes, replaced)
        return {leaves[node] for node in graph.needed(new, Kind.STATE) if node in leaves}

    waiting = reads(
        {model.ends}
        | {action.reward for action in model.actions}
        | {action.legal for action in model.actions}
    )
    ints = (each for each, place in enumerate(model.packing.places) if place.offset)
    relevant = {number, *ints}
    while waiting:
        relevant |= waiting
        groups = [place for place, group in enumerate(model.groups) if waiting & {*group}]
        nodes = {
            node
            for action in model.actions
            for node in (
                *(node for each in waiting for branch in action.laws[each] for node in branch),
                *(node for place in groups for node in nodes_of(action.joint[place])),
            )
        }
        waiting = reads(nodes) - relevant
    return relevant


def _merge(model: GroundModel, number: int, value: bool, relevant: set[int]) -> Merge:
    keep = np.zeros(model.packing.words, np.uint64)
    for each in relevant:
        keep[model.packing.places[each].word] |= model.packing.places[each].mask
    place = model.packing.places[number]
    return Merge(place.word, int(place.mask), int(place.mask) if value else 0, keep)
