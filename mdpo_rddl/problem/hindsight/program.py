"""A mixed integer linear program, put together from affine expressions."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

# of scipy's `milp`
_UNBOUNDED = 3


class NotLinearError(Exception):
    """A problem cannot be written as a linear program; says why."""


@dataclass(frozen=True)
class Affine:
    """A constant and multiples of variables.

    Attributes:
      constant: the first.
      terms: per variable its factor.
      is_bool: whether it is 0 or 1.
    """

    constant: float
    terms: Mapping[int, float]
    is_bool: bool = False

    def __add__(self, other: "Affine | float") -> "Affine":
        if not isinstance(other, Affine):
            return Affine(self.constant + other, self.terms)
        terms = dict(self.terms)
        for variable, factor in other.terms.items():
            terms[variable] = terms.get(variable, 0.0) + factor
        return Affine(self.constant + other.constant, terms)

    def __radd__(self, other: float) -> "Affine":
        return self + other

    def __sub__(self, other: "Affine | float") -> "Affine":
        return self + (-1.0 * other)

    def __rsub__(self, other: float) -> "Affine":
        return -1.0 * self + other

    def __rmul__(self, factor: float) -> "Affine":
        terms = {variable: factor * each for variable, each in self.terms.items()}
        return Affine(factor * self.constant, terms)


Value = float | Affine
"""A number, which a bool is too, or what a plan decides."""


class Optimum(NamedTuple):
    """What a solver has found.

    Attributes:
      bound: no values of the variables give more, up to the solver's tolerance; None if unknown.
      values: of the variables, the best found; None if none was.
    """

    bound: float | None
    values: np.ndarray | None


@dataclass
class Program:
    """Variables with bounds, and rows: a lower and an upper bound of an affine expression.

    Attributes:
      functions: what stands for functions of its variables, so that each is written once.
    """

    functions: dict[Any, Value] = field(default_factory=dict)
    _lower: list[float] = field(default_factory=list)
    _upper: list[float] = field(default_factory=list)
    _integral: list[bool] = field(default_factory=list)
    _rows: list[tuple[Affine, float, float]] = field(default_factory=list)
    _at_most: dict[int, list[Affine]] = field(default_factory=dict)
    _at_least: dict[int, list[Affine]] = field(default_factory=dict)

    def variable(self, lower: float, upper: float, integral: bool = False) -> Affine:
        """A new variable within bounds, which may be infinite."""
        self._lower.append(lower)
        self._upper.append(upper)
        self._integral.append(integral)
        return Affine(0.0, {len(self._lower) - 1: 1.0}, integral and (lower, upper) == (0.0, 1.0))

    def switch(self) -> Affine:
        """A new variable that is 0 or 1."""
        return self.variable(0.0, 1.0, integral=True)

    def require(self, value: Affine, lower: float = -math.inf, upper: float = math.inf) -> None:
        """Keeps an expression within bounds."""
        if lower > -math.inf or upper < math.inf:
            self._rows.append((value, lower, upper))

    def relate(
        self,
        variable: Affine,
        *,
        at_most: Affine | float | None = None,
        at_least: Affine | float | None = None,
    ) -> None:
        """Requires that a variable be no more, or no less, than an expression, and remembers it."""
        (number,) = variable.terms
        if at_most is not None:
            self.require(variable - at_most, upper=0.0)
            if isinstance(at_most, Affine):
                self._at_most.setdefault(number, []).append(at_most)
        if at_least is not None:
            self.require(variable - at_least, lower=0.0)
            if isinstance(at_least, Affine):
                self._at_least.setdefault(number, []).append(at_least)

    def interval(self, value: Value) -> tuple[float, float]:
        """Bounds of an expression, from those of its variables and what they are related to."""
        if not isinstance(value, Affine):
            return float(value), float(value)
        return self._least(value), -self._least(-1.0 * value)

    def _least(self, value: Affine) -> float:
        """A lower bound: that of the variables' bounds, or what relations make of it."""
        least = self._plain_least(value)
        for variable, factor in value.terms.items():
            relations = self._at_least if factor > 0.0 else self._at_most
            for other in relations.get(variable, ()):
                rest = {v: f for v, f in value.terms.items() if v != variable}
                instead = Affine(value.constant, rest) + factor * other
                least = max(least, self._plain_least(instead))
        return least

    def _plain_least(self, value: Affine) -> float:
        least = value.constant
        for variable, factor in value.terms.items():
            if factor > 0.0:
                least += factor * self._lower[variable]
            elif factor < 0.0:
                least += factor * self._upper[variable]
        return least

    def named(self, value: Value, most_terms: int = 1) -> Value:
        """The expression as one variable if it has more terms: what is made of it stays short."""
        if not isinstance(value, Affine) or len(value.terms) <= most_terms:
            return value
        name = self.variable(*self.interval(value))
        self.require(name - value, 0.0, 0.0)
        return Affine(name.constant, name.terms, value.is_bool)

    @property
    def is_mixed(self) -> bool:
        """Whether some variables are integers."""
        return any(self._integral)

    def maximise(self, objective: Value, seconds: float, relaxed: bool) -> Optimum:
        """Solves the program with HiGHS.

        Args:
          objective: what shall be large.
          seconds: limit of the time.
          relaxed: whether integers may be any numbers within their bounds.
        """
        if not isinstance(objective, Affine):
            return Optimum(float(objective), np.clip(0.0, self._lower, self._upper))
        from scipy.optimize import Bounds, LinearConstraint, milp  # takes long to import
        from scipy.sparse import csr_array

        count = len(self._lower)
        costs = np.zeros(count)
        for variable, factor in objective.terms.items():
            costs[variable] = -factor
        starts = np.cumsum([0, *(len(value.terms) for value, _, _ in self._rows)])
        columns = [variable for value, _, _ in self._rows for variable in value.terms]
        factors = [factor for value, _, _ in self._rows for factor in value.terms.values()]
        constraints = []
        if self._rows:
            matrix = csr_array((factors, columns, starts), shape=(len(self._rows), count))
            low = [low - value.constant for value, low, _ in self._rows]
            high = [high - value.constant for value, _, high in self._rows]
            constraints = [LinearConstraint(matrix, low, high)]
        result = milp(
            costs,
            integrality=np.zeros(count) if relaxed else np.array(self._integral, int),
            bounds=Bounds(np.array(self._lower), np.array(self._upper)),
            constraints=constraints,
            options={"time_limit": max(seconds, 0.1)},
        )
        if result.status == _UNBOUNDED:
            raise NotLinearError("the linear program has no bound, as where an action has no box")
        bound = None
        if result.mip_dual_bound is not None and np.isfinite(result.mip_dual_bound):
            bound = objective.constant - float(result.mip_dual_bound)
        elif result.status == 0:
            bound = objective.constant - float(result.fun)
        return Optimum(bound, result.x)
