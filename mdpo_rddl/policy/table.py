"""A table of actions by state and step, and what is known of its return: plain data."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

_ARRAYS = ("places", "merges", "states", "first_run", "until_step", "action")
_ACTIONS, _VALUES, _MERGES = "actions/", "values", "merges"
_WORD = 64


@dataclass(frozen=True)
class ActionTable:
    """What to do in each of S states, run-length encoded over the steps.

    Attributes:
      places: per ground state variable, in the fluents' order, its place in a packed state:
        word, shift, bits and offset [V, 4].
      merges: states that count as one: where the bits of a mask have a value, only the bits to
        keep matter; mask, value and bits to keep [merges, 3, words].
      states: packed, in the order of their keys [S, words].
      first_run: the runs of state s are those from `first_run[s]` to `first_run[s + 1]` [S + 1].
      until_step: the last step of each run; a run begins after the one before of its state.
      action: played in each run, a number below A.
      actions: per action fluent the values of all joint actions [A, *shape].
      objects: per state fluent whose values are objects, their names [n]; else none.
      values: of the best policy from each step and state on [H, S]; None if they were not kept.
    """

    places: np.ndarray
    merges: np.ndarray
    states: np.ndarray
    first_run: np.ndarray
    until_step: np.ndarray
    action: np.ndarray
    actions: Mapping[str, np.ndarray]
    fluents: tuple[str, ...]
    objects: Mapping[str, tuple[str, ...]]
    values: np.ndarray | None = None


@dataclass(frozen=True)
class Optimum:
    """What backward induction has proven.

    Attributes:
      value: expected return of the best policy from the initial state.
      states: number of reachable states.
      transitions: probabilities that were stored.
      actions: number of joint actions that differ.
      seconds: that it took; None for one that was loaded, a file says nothing of time.
    """

    value: float
    states: int
    transitions: int
    actions: int
    seconds: float | None


@dataclass(frozen=True)
class Estimate:
    """What simulated episodes say of a table that is not proven to be the best.

    Attributes:
      value: mean return.
      error: its standard error.
      episodes: that were simulated.
      missed: share of the decisions in states that are not in the table.
      states: number of states in the table.
    """

    value: float
    error: float
    episodes: int
    missed: float
    states: int


Claim = Optimum | Estimate
"""What is known of a table's return."""


def table_tensors(table: ActionTable) -> dict[str, np.ndarray]:
    """The arrays of a table by their names; those of the actions after `actions/`."""
    arrays = {name: getattr(table, name) for name in _ARRAYS}
    arrays |= {f"{_ACTIONS}{name}": values for name, values in table.actions.items()}
    if table.values is not None:
        arrays[_VALUES] = table.values
    return {name: np.ascontiguousarray(values) for name, values in arrays.items()}


def table_text(table: ActionTable, claim: Claim) -> dict[str, str]:
    """The rest of a table, and what is known of its return, without the time it took, as JSON."""
    name = "optimum" if isinstance(claim, Optimum) else "estimate"
    figures = {key: value for key, value in asdict(claim).items() if key != "seconds"}
    return {
        "fluents": json.dumps(table.fluents),
        "objects": json.dumps(dict(table.objects)),
        name: json.dumps(figures),
    }


def parse_table(
    tensors: Mapping[str, np.ndarray], text: Mapping[str, str]
) -> tuple[ActionTable, Claim]:
    """A table of its tensors and its text, whoever wrote them.

    Raises:
      AttributeError, KeyError, OverflowError, TypeError, ValueError: if something is missing,
        or does not fit together.
    """
    actions = {
        name.removeprefix(_ACTIONS): values
        for name, values in tensors.items()
        if name.startswith(_ACTIONS)
    }
    expected = {*_ARRAYS, *(_ACTIONS + name for name in actions)}
    _require(set(tensors) - {_VALUES} == expected, "tensors")
    objects = {name: _names(values) for name, values in json.loads(text["objects"]).items()}
    table = ActionTable(
        **{name: tensors[name] for name in _ARRAYS if name != _MERGES},
        merges=_masks(tensors[_MERGES]),
        actions=actions,
        fluents=_names(json.loads(text["fluents"])),
        objects=objects,
        values=tensors.get(_VALUES),
    )
    _check(table)
    if "estimate" in text:
        return table, _estimate(json.loads(text["estimate"]))
    return table, _optimum(json.loads(text["optimum"]))


def _names(values: Iterable[Any]) -> tuple[str, ...]:
    names = tuple(values)
    _require(all(isinstance(name, str) for name in names), "names")
    return names


def _optimum(figures: Mapping[str, Any]) -> Optimum:
    value = float(figures["value"])
    _require(bool(np.isfinite(value)), "figures")
    counts = {name: int(figures[name]) for name in ("states", "transitions", "actions")}
    return Optimum(value=value, seconds=None, **counts)


def _estimate(figures: Mapping[str, Any]) -> Estimate:
    value, error, missed = (float(figures[name]) for name in ("value", "error", "missed"))
    _require(bool(np.isfinite([value, error, missed]).all()), "figures")
    counts = {name: int(figures[name]) for name in ("episodes", "states")}
    return Estimate(value=value, error=error, missed=missed, **counts)


def _require(holds: bool, what: str) -> None:
    if not holds:
        raise ValueError(f"its {what} do not fit together")


def _masks(merges: np.ndarray) -> np.ndarray:
    """Merges as tables have them now.

    Those of earlier files have the number of a word, mask and value in it, and the bits to keep
    [merges, 3 + words].
    """
    if merges.ndim != 2:
        return merges
    words = merges.shape[1] - 3
    _require(merges.dtype == np.uint64 and bool(np.all(merges[:, 0] < words)), "merges")
    found = np.zeros((len(merges), 3, words), np.uint64)
    found[np.arange(len(merges)), 0, merges[:, 0]] = merges[:, 1]
    found[np.arange(len(merges)), 1, merges[:, 0]] = merges[:, 2]
    found[:, 2] = merges[:, 3:]
    return found


def _check(table: ActionTable) -> None:
    """Raises ValueError unless every number that points somewhere points into the table."""
    places, runs = table.places, len(table.action)
    for name in ("places", "first_run", "until_step", "action"):
        _require(getattr(table, name).dtype.kind == "i", name)
    _require(places.ndim == 2 and places.shape[1:] == (4,), "places")
    word, shift, bits = places[:, 0], places[:, 1], places[:, 2]
    _require(bool(np.all((word >= 0) & (shift >= 0) & (bits > 0) & (bits < _WORD))), "places")
    _require(bool(np.all(shift + bits <= _WORD)), "places")
    words = int(word[-1]) + 1 if len(word) else 1
    _require(bool(np.all(word < words)), "places")
    states, merges = table.states, table.merges
    _require(states.ndim == 2 and states.shape[1:] == (words,), "states")
    _require(merges.shape[1:] == (3, words), "merges")
    _require(states.dtype == merges.dtype == np.uint64, "states")
    first = table.first_run
    _require(first.shape == (len(states) + 1,) and bool(np.all(np.diff(first) > 0)), "runs")
    _require(int(first[0]) == 0 and int(first[-1]) == runs, "runs")
    _require(table.until_step.shape == table.action.shape == (runs,), "runs")
    if (kept := table.values) is not None:
        steps = int(table.until_step.max(initial=-1)) + 1
        fits = kept.shape == (steps, len(states)) and kept.dtype == np.float32
        _require(fits and bool(np.isfinite(kept).all()), _VALUES)
    counts = {len(values) if values.ndim else 0 for values in table.actions.values()}
    _require(len(counts) == 1 and min(counts) > 0, "actions")
    _require(bool(np.all((table.action >= 0) & (table.action < min(counts)))), "actions")
