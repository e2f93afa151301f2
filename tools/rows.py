"""Rows of measurements, which a tool adds to a CSV file one by one, each with its commit."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mdpo_rddl.machine.versions import commit


class Rows:
    """A CSV file, which gets its head if it is new."""

    def __init__(self, path: str, columns: Sequence[str]) -> None:
        """Begins the file.

        Args:
          path: the file.
          columns: names of what each row says; one of them is "commit".
        """
        self._path, self._columns = Path(path), columns
        if not self._path.exists():
            self._path.write_text(",".join(columns) + "\n")

    def add(self, values: Mapping[str, Any]) -> None:
        """Adds a row.

        Args:
          values: one for each column but the commit.
        """
        with self._path.open("a", newline="") as file:
            writer = csv.DictWriter(file, self._columns, lineterminator="\n")
            writer.writerow({**values, "commit": commit()})
