"""Results as rows of a CSV file, written one by one so that a stopped run goes on."""

import csv
import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import (
    MOST_BYTES,
    append,
    read_bounded,
    read_json,
    write_atomically,
)


class Records:
    """Rows with named columns, of which the first few identify a row.

    Attributes:
      path: the CSV file; its conditions stand beside it, in a JSON file of the same name.
      columns: names of all columns.
      keys: names of the columns that identify a row.
    """

    def __init__(
        self,
        path: Path,
        columns: Iterable[str],
        keys: Iterable[str],
        conditions: Mapping[str, Any] | None = None,
    ) -> None:
        """Opens the file, or starts it.

        Args:
          path: the CSV file.
          columns: names of all columns.
          keys: names of the columns that identify a row.
          conditions: what all rows have in common, as JSON can hold it; None for who only reads,
            who neither writes nor compares them.

        Raises:
          InputError: if it cannot be written, holds anything but rows of these columns, or
            rows that were made under other conditions.
        """
        self.path, self.columns, self.keys = path, tuple(columns), tuple(keys)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                write_atomically(path, ",".join(self.columns) + "\n")
            text = read_bounded(path, MOST_BYTES).decode()
            path.open("r+b").close()  # says now whether rows can be added
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        except UnicodeDecodeError as error:
            raise InputError(f"{path}: is not a CSV file of results") from error
        try:
            found, *rows = list(csv.reader(text.splitlines())) or [[]]
        except csv.Error as error:
            raise InputError(f"{path}: is not a CSV file of results: {error}") from error
        if tuple(found) != self.columns:
            raise InputError(f"{path}: holds other results (columns {', '.join(found)})")
        for line, row in enumerate(rows, start=2):
            if len(row) != len(self.columns):
                raise InputError(f"{path}:{line}: is not a whole row; delete the line")
        if not text.endswith("\n"):
            raise InputError(f"{path}:{len(rows) + 1}: the line has no end; delete or end it")
        self.rows = [dict(zip(self.columns, row, strict=True)) for row in rows]
        if conditions is not None:
            self._keep(dict(conditions))

    def _keep(self, conditions: dict[str, Any]) -> None:
        path = self.path.with_suffix(".json")
        if not self.rows or not path.exists():
            write_atomically(path, json.dumps(conditions, indent=2) + "\n")
            return
        try:
            kept = read_json(path)
            if not isinstance(kept, dict):
                raise ValueError("no object")
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from error
        except ValueError as error:
            raise InputError(f"{path}: is not a file of conditions: {error}") from error
        for name, value in conditions.items():
            if kept.get(name) != value:
                raise InputError(
                    f"{self.path}: holds results made with another {name} (see {path}); "
                    "use another --out"
                )

    def has(self, *key: Any) -> bool:
        """Whether a row with these key values is there."""
        wanted = tuple(str(value) for value in key)
        return any(tuple(row[name] for name in self.keys) == wanted for row in self.rows)

    def add(self, *values: Any) -> None:
        """Appends one row and writes it at once.

        Raises:
          InputError: naming the file, if it cannot be written; the rows before stay.
        """
        row = {name: str(value) for name, value in zip(self.columns, values, strict=True)}
        text = io.StringIO(newline="")
        csv.DictWriter(text, self.columns, lineterminator="\n").writerow(row)
        append(self.path, text.getvalue().encode())
        self.rows.append(row)


def mean_and_spread(values: list[float]) -> str:
    """A table's cell: mean and standard deviation (n - 1); empty without values."""
    if not values:
        return ""
    return f"{np.mean(values):,.0f} ± {np.std(values, ddof=min(1, len(values) - 1)):,.0f}"
