"""Scopes: the tuples of objects for which an expression is evaluated, as columns of indices."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class Scope:
    """K tuples of objects, one column of indices [K] for each variable.

    Attributes:
      columns: per variable (`?x`) the index of its object in each tuple [K].
      sizes: per variable, the number of objects of its type.
      rows: number of tuples K; 1 where there is no variable.
    """

    columns: Mapping[str, np.ndarray] = field(default_factory=dict)
    sizes: Mapping[str, int] = field(default_factory=dict)
    rows: int = 1

    def extended(self, variables: Iterable[tuple[str, int]]) -> "Scope":
        """Each tuple with every object of further (variable, number of objects), in order."""
        scope = self
        for name, size in variables:
            columns = {n: np.repeat(column, size) for n, column in scope.columns.items()}
            columns[name] = np.tile(np.arange(size), scope.rows)
            scope = Scope(columns, {**scope.sizes, name: size}, scope.rows * size)
        return scope

    def taken(self, which: np.ndarray) -> "Scope":
        """The tuples with these numbers [k], or where a mask [K] is true."""
        columns = {name: column[which] for name, column in self.columns.items()}
        rows = int(np.count_nonzero(which)) if which.dtype == bool else len(which)
        return Scope(columns, self.sizes, rows)

    def number(self, names: Iterable[str]) -> np.ndarray:
        """The position [K] of each tuple among all combinations of some variables' objects."""
        number = np.zeros(self.rows, np.int64)
        for name in names:
            number = number * self.sizes[name] + self.columns[name]
        return number

    def restricted(self, names: Iterable[str]) -> tuple["Scope", np.ndarray | None]:
        """The distinct tuples of some variables, in order, and the number [K] of each tuple's.

        None in place of the numbers where the tuples are these already.
        """
        kept = [name for name in self.columns if name in set(names)]
        if not kept:
            return Scope(), np.zeros(self.rows, np.int64)
        _, first, inverse = np.unique(self.number(kept), return_index=True, return_inverse=True)
        if len(first) == self.rows and len(kept) == len(self.columns):
            return self, None
        columns = {name: self.columns[name][first] for name in kept}
        scope = Scope(columns, {name: self.sizes[name] for name in kept}, len(first))
        in_order = len(first) == self.rows and (inverse == np.arange(self.rows)).all()
        return scope, None if in_order else inverse

    @cached_property
    def signature(self) -> Mapping[str, bytes]:
        """What two equal columns have in common, per variable."""
        return {name: column.tobytes() for name, column in self.columns.items()}
