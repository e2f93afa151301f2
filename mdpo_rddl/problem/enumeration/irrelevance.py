"""States that differ only in what no longer matters, taken as one.

Once bools have values that they keep for ever, other variables may have no way left to reach
the rewards, the preconditions or the end of the episode. Their bits are cleared then. Ints stay as
they are: cleared bits would be a value from which the next one may not fit.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mdpo_rddl.problem.enumeration.graph import Kind
from mdpo_rddl.problem.enumeration.joint import nodes_of
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import GroundModel

# nodes of all laws times guesses, with which the time to find merges grows, to seconds for so many.
# The clock must not decide: a search that goes on in another process has to join the same states.
_MOST_WORK = 3_000_000


class Merge(NamedTuple):
    """Where the bits `mask` of a state are `value`, only the bits `keep` matter [words] each."""

    mask: np.ndarray
    value: np.ndarray
    keep: np.ndarray


def find_merges(model: GroundModel, limits: EnumerationLimits) -> list[Merge]:
    """The merges that bools allow which keep their values.

    Each bool with each of its values, and each place of what is at one place at a time: where it
    has been it may never be again. There are none where finding them would take too long. A merged
    state, merged again, is the same, and so are those that follow it.
    """
    nodes = {node for action in model.actions for node in action.nodes()}
    most_guesses = _MOST_WORK // max(1, len(model.graph.needed(nodes)))
    alone = 2 * sum(model.is_bool)
    groups = list(_one_hot(model)) if alone <= most_guesses else []
    if alone + sum(map(len, groups)) > most_guesses:
        return []
    laws, known, found = _Laws(model), set[frozenset[tuple[int, bool]]](), list[Merge]()
    for values in _guesses(model, groups):
        limits.check_time()
        kept = laws.kept(values)
        if not kept or (items := frozenset(kept.items())) in known:
            continue
        known.add(items)
        if len(relevant := laws.relevant(kept)) < len(model.variables):
            found.append(_merge(model, kept, relevant))
    return _compatible(found, limits)


def merged(states: np.ndarray, merges: Iterable[Merge]) -> np.ndarray:
    """States [N, words] without what does not matter."""
    for mask, value, keep in merges:
        applies = ((states & mask) == value).all(axis=1)
        if applies.any():
            states = np.where(applies[:, np.newaxis], states & keep, states)
    return states


def _guesses(model: GroundModel, groups: Iterable[Sequence[int]]) -> Iterator[dict[int, bool]]:
    """Values of bools, of which some may be kept for ever."""
    for number, is_bool in enumerate(model.is_bool):
        for value in (False, True) if is_bool else ():
            yield {number: value}
    for group in groups:
        for place in group:
            yield {number: number == place for number in group}


def _one_hot(model: GroundModel) -> Iterator[Sequence[int]]:
    """The bools of a fluent, all or those of each object, of which one is true at first.

    It does not matter whether one is true in all states: a merge holds where its values do.
    """
    fluents: dict[str, dict[tuple[int, ...], int]] = {}
    for number, (name, place) in enumerate(model.variables):
        if model.is_bool[number]:
            fluents.setdefault(name, {})[place] = number
    initial = model.initial[np.newaxis]
    for numbers in fluents.values():
        is_true = {n: bool(model.packing.decode(n, initial)[0]) for n in numbers.values()}
        for groups in _groupings(numbers):
            is_one = all(sum(is_true[number] for number in group) == 1 for group in groups)
            if is_one and len(groups[0]) > 1:
                yield from groups
                break


def _groupings(numbers: Mapping[tuple[int, ...], int]) -> Iterator[list[list[int]]]:
    """All numbers in one group, then by each index of their places."""
    yield [list(numbers.values())]
    for axis in range(len(next(iter(numbers)))):
        groups: dict[int, list[int]] = {}
        for place, number in numbers.items():
            groups.setdefault(place[axis], []).append(number)
        yield list(groups.values())


class _Laws:
    """The laws of a model's variables, with bools put in that keep their values."""

    def __init__(self, model: GroundModel) -> None:
        self._graph, variables = model.graph, range(len(model.variables))
        self._leaves = {model.leaf(number): number for number in variables}
        self._leaf = {number: leaf for leaf, number in self._leaves.items()}
        self._nodes = [
            {node for action in model.actions for branch in action.laws[number] for node in branch}
            for number in variables
        ]
        for place, group in enumerate(model.groups):
            joint = {node for action in model.actions for node in nodes_of(action.joint[place])}
            for number in group:
                self._nodes[number] = joint
        # a bool of a group may well keep its value, but its law is not one of its own
        self._chances = [
            {law[0].value for action in model.actions if (law := action.laws[number])}
            if is_bool
            else set()
            for number, is_bool in enumerate(model.is_bool)
        ]
        self._is_read = [self._reads(chances, {}) for chances in self._chances]
        self._read_by: dict[int, set[int]] = {number: set() for number in variables}
        for number, read in enumerate(self._is_read):
            for each in read:
                self._read_by[each].add(number)
        self._answers: dict[tuple[int, bool, tuple[tuple[int, bool], ...]], bool] = {}
        self._ints = {number for number in variables if model.packing.places[number].offset}
        self._aims = {model.ends}
        for action in model.actions:
            self._aims |= {action.reward, action.legal}

    def kept(self, values: Mapping[int, bool]) -> dict[int, bool]:
        """Those of the values that bools keep for ever, whatever is done, once they have them."""
        kept, waiting = dict(values), set(values)
        while waiting:
            number = waiting.pop()
            if not self._is_kept(number, kept):
                del kept[number]
                waiting = (waiting | self._read_by[number]) & kept.keys()
        return kept

    def relevant(self, kept: Mapping[int, bool]) -> set[int]:
        """The variables that still matter, and those that are kept."""
        relevant = {*kept}
        waiting = self._reads(self._aims, kept) | self._ints
        while waiting := waiting - relevant:
            relevant |= waiting
            waiting = self._reads(set().union(*(self._nodes[each] for each in waiting)), kept)
        return relevant

    def _is_kept(self, number: int, kept: Mapping[int, bool]) -> bool:
        read = {each: kept[each] for each in sorted(self._is_read[number]) if each in kept}
        # of one guess and the next most is the same
        question = number, kept[number], tuple(read.items())
        if question not in self._answers:
            graph = self._graph
            new = graph.substitute(self._chances[number], self._constants(read))
            same = (graph.is_constant(n) and graph.values[n] == kept[number] for n in new)
            self._answers[question] = bool(new) and all(same)
        return self._answers[question]

    def _reads(self, nodes: Iterable[int], kept: Mapping[int, bool]) -> set[int]:
        """The variables that nodes read."""
        new = self._graph.substitute(nodes, self._constants(kept))
        needed = self._graph.needed(new, Kind.STATE)
        return {self._leaves[node] for node in needed if node in self._leaves}

    def _constants(self, kept: Mapping[int, bool]) -> dict[int, int]:
        return {self._leaf[number]: self._graph.constant(value) for number, value in kept.items()}


def _compatible(merges: Iterable[Merge], limits: EnumerationLimits) -> list[Merge]:
    """Merges after which a state's bits are those that all that apply to it keep.

    So a state and what it is merged with are followed by the same merged states. For that a merge
    must clear nothing that another one reads, unless it keeps no more than that one, too.
    """
    found: list[Merge] = []
    for merge in sorted(merges, key=lambda merge: int(np.bitwise_count(merge.keep).sum())):
        limits.check_time()
        if all(_agree(merge, other) and _agree(other, merge) for other in found):
            found.append(merge)
    return found


def _agree(one: Merge, other: Merge) -> bool:
    """Whether the other merge may come before the one."""
    if np.any((one.value ^ other.value) & one.mask & other.mask):
        return True  # never in the same state
    return not np.any(one.mask & ~other.keep) or not np.any(other.keep & ~one.keep)


def _merge(model: GroundModel, kept: Mapping[int, bool], relevant: Iterable[int]) -> Merge:
    mask, value, keep = np.zeros((3, model.packing.words), np.uint64)
    places = model.packing.places
    for number, is_true in kept.items():
        word = places[number].word
        mask[word] |= places[number].mask
        value[word] |= places[number].mask if is_true else np.uint64(0)
    for number in relevant:
        keep[places[number].word] |= places[number].mask
    return Merge(mask, value, keep)
