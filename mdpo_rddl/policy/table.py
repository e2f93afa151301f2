"""A policy that looks its action up by step and state: arrays, in memory and in a file."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
from safetensors.numpy import save

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import write_atomically
from mdpo_rddl.problem.enumeration.irrelevance import Merge, merged
from mdpo_rddl.problem.enumeration.packing import Packing, Place, keys

FORMAT = "mdpo-rddl table 1"


@dataclass(frozen=True)
class ActionTable:
    """What to do in each of S states, run-length encoded over the steps.

    Attributes:
      places: per ground state variable, in the fluents' order, its place in a packed state:
        word, shift, bits and offset [V, 4].
      merges: states that count as one: where the bits of a mask in a word have a value, only
        the bits to keep matter; word, mask, value and bits to keep [merges, 3 + words].
      states: packed, in the order of their keys [S, words].
      first_run: the runs of state s are those from `first_run[s]` to `first_run[s + 1]` [S + 1].
      until_step: the last step of each run; a run begins after the one before of its state.
      action: played in each run, a number below A.
      actions: per action fluent the values of all joint actions [A, *shape].
      objects: per state fluent whose values are objects, their names [n]; else none.
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


class TablePolicy:
    """Plays a table; where a state is not in it, the no-op.

    Attributes:
      misses: at how many decisions the state was not in the table.
    """

    def __init__(self, table: ActionTable) -> None:
        """Makes the keys of the table's states."""
        self.table, self.misses = table, 0
        self._packing = Packing(tuple(Place(*map(int, place)) for place in table.places))
        self._merges = [
            Merge(int(word), int(mask), int(value), np.array(keep, np.uint64))
            for word, mask, value, *keep in table.merges
        ]
        self._keys = keys(table.states)

    def __call__(self, step: int, observation: Mapping[str, Any]) -> dict[str, Any]:
        """The action at a step.

        Args:
          step: number of decisions before this one.
          observation: per state fluent its values [*shape], as the vectorized environment's.

        Returns:
          Per action fluent its values [*shape].
        """
        number = self._number(step, observation)
        return {
            name: values[number] if values.ndim > 1 else values[number].item()
            for name, values in self.table.actions.items()
        }

    def _number(self, step: int, observation: Mapping[str, Any]) -> int:
        """The number of the action; 0, the no-op's, for an unknown state."""
        table = self.table
        values = np.concatenate([self._values(name, observation[name]) for name in table.fluents])
        try:
            (state,) = merged(self._packing.encode_all(values.tolist())[np.newaxis], self._merges)
        except OverflowError:
            self.misses += 1
            return 0
        place = int(np.searchsorted(self._keys, keys(state[np.newaxis])[0]))
        if place == len(self._keys) or not np.array_equal(table.states[place], state):
            self.misses += 1
            return 0
        start, stop = table.first_run[place : place + 2]
        run = start + np.searchsorted(table.until_step[start:stop], step)
        return int(table.action[min(run, stop - 1)])

    def _values(self, name: str, observed: Any) -> np.ndarray:
        values = np.ravel(np.asarray(observed))
        if values.dtype.kind in "UO":
            names = self.table.objects[name]
            return np.array([names.index(str(each).removeprefix("@")) for each in values])
        return values.astype(np.int64)


def save_table(path: Path, table: ActionTable, digest: str) -> None:
    """Writes a table.

    Args:
      path: of the file.
      table: what to write.
      digest: of the problem that it belongs to.
    """
    arrays = {
        field.name: getattr(table, field.name)
        for field in fields(table)
        if isinstance(getattr(table, field.name), np.ndarray)
    }
    arrays |= {f"actions/{name}": values for name, values in table.actions.items()}
    metadata = {"format": FORMAT, "problem": digest, "fluents": "\n".join(table.fluents)}
    metadata |= {f"objects/{name}": "\n".join(names) for name, names in table.objects.items()}
    arrays = {name: np.ascontiguousarray(values) for name, values in arrays.items()}
    write_atomically(path, save(arrays, metadata=metadata))


def load_table(path: Path, digest: str) -> ActionTable:
    """Reads a table back.

    Raises:
      InputError: naming the file, if it is missing, damaged or of another problem.
    """
    try:
        with safetensors.safe_open(str(path), framework="numpy") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such table") from error
    except (OSError, safetensors.SafetensorError) as error:
        raise InputError(f"{path}: damaged table: {' '.join(str(error).split())}") from error
    if metadata.get("format") != FORMAT:
        raise InputError(f"{path}: not a table of mdpo-rddl")
    if metadata.get("problem") != digest:
        raise InputError(f"{path}: a table of another problem")
    named = {name.partition("/")[2]: value for name, value in arrays.items() if "/" in name}
    plain = {name: value for name, value in arrays.items() if "/" not in name}
    objects = {
        name.partition("/")[2]: tuple(text.split("\n"))
        for name, text in metadata.items()
        if name.startswith("objects/")
    }
    try:
        fluents = tuple(metadata["fluents"].split("\n"))
        return ActionTable(actions=named, fluents=fluents, objects=objects, **plain)
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: damaged table: {error}") from error
