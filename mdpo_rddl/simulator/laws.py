"""pyRDDLGym's functions and distributions for many replicas at once, an error only in its own.

The law of each distribution, and what makes it an error, are those of pyRDDLGym's `RDDLSimulator`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

INT = np.int64
REAL = np.float64


def _log_gamma(x: np.ndarray) -> np.ndarray:
    """The asymptotic series that pyRDDLGym evaluates (OEIS A046969), per replica as there.

    x is [K, B]; the smallest x of a replica says how often its argument is moved up by two.
    """
    moves = np.maximum(np.ceil((7.0 - np.min(x, axis=0)) / 2.0), 0.0)
    shifted = x + 2.0 * moves
    square = shifted * shifted
    inner = 1 / (99 * square / 140) * (1 + 1 / (910 * square / 3))
    series = -1 + 1 / (7 * square / 2) * (1 + 1 / (4 * square / 3) * (-1 + inner))
    value = (shifted - 0.5) * np.log(shifted) - shifted + 0.5 * np.log(2 * np.pi)
    value = value + 1 / (12 * shifted) * (1 + 1 / (30 * square) * series)
    for move in range(int(np.max(moves, initial=0.0)), 0, -1):
        at = x + 2.0 * (move - 1)
        value = np.where(move <= moves, value - np.log(at) - np.log(at + 1), value)
    return value


def _whole(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda x: function(x).astype(INT)


UNARY: Mapping[str, Callable[[Any], Any]] = {
    "abs": np.abs,
    "sgn": _whole(np.sign),
    "round": _whole(np.round),
    "floor": _whole(np.floor),
    "ceil": _whole(np.ceil),
    "cos": np.cos,
    "sin": np.sin,
    "tan": np.tan,
    "acos": np.arccos,
    "asin": np.arcsin,
    "atan": np.arctan,
    "cosh": np.cosh,
    "sinh": np.sinh,
    "tanh": np.tanh,
    "exp": np.exp,
    "ln": np.log,
    "sqrt": np.sqrt,
    "lngamma": _log_gamma,
    "gamma": lambda x: np.exp(_log_gamma(x)),
}
BINARY: Mapping[str, Callable[[Any, Any], Any]] = {
    "div": lambda x, y: np.floor_divide(x, y).astype(INT),
    "mod": lambda x, y: np.mod(x, y).astype(INT),
    "fmod": np.mod,
    "min": np.minimum,
    "max": np.maximum,
    "pow": np.power,
    "log": lambda x, y: np.log(x) / np.log(y),
    "hypot": np.hypot,
}
WHOLE_RESULTS = {"sgn", "round", "floor", "ceil", "div", "mod"}
"""Functions whose value is an integer whatever their arguments."""
ALIKE_RESULTS = {"abs", "min", "max", "pow", "fmod"}
"""Functions whose value is an integer where all of their arguments are."""
RELATIONS: Mapping[str, Callable[[Any, Any], Any]] = {
    ">=": np.greater_equal,
    "<=": np.less_equal,
    "<": np.less,
    ">": np.greater,
    "==": np.equal,
    "~=": np.not_equal,
}


def _positive(*values: Any) -> Any:
    return np.logical_and.reduce(np.broadcast_arrays(*(value > 0 for value in values)))


def _probability(p: Any) -> Any:
    return (p >= 0) & (p <= 1)


_LARGEST_RATE = np.iinfo(INT).max - 10 * np.sqrt(np.iinfo(INT).max)


@dataclass(frozen=True)
class Law:
    """How a distribution is drawn.

    Attributes:
      draw: (generator, size, *parameters) -> values [K, B]; the parameters broadcast to the size.
        Where there is a base, (its draws [K, B], *parameters) -> values.
      domain: for which parameters neither pyRDDLGym nor numpy raises an error.
      safe: parameters in that domain.
      kind: of the values: `b`, `i` or `f`.
      base: the generator's method whose draws need no parameters and are the only ones.
    """

    draw: Callable[..., np.ndarray]
    domain: Callable[..., Any]
    safe: tuple[float, ...]
    kind: str = "f"
    base: str = ""


def _uniform(u: Any, low: Any, high: Any) -> np.ndarray:
    return low + (high - low) * u


def _normal(z: Any, mean: Any, variance: Any) -> np.ndarray:
    return mean + np.sqrt(variance) * z


def _gompertz(u: Any, shape: Any, scale: Any) -> np.ndarray:
    return np.log(1.0 - np.log1p(-u) / shape) / scale


def _kumaraswamy(u: Any, a: Any, b: Any) -> np.ndarray:
    return (1.0 - u ** (1.0 / b)) ** (1.0 / a)


def _second_positive(mean: Any, scale: Any) -> Any:
    return (scale > 0) & np.ones(np.shape(mean), bool)


_ONES = (1.0, 1.0)
UNIFORM = "random"
"""The base of what is made of numbers that are uniform on [0, 1)."""
LAWS: Mapping[str, Law] = {
    "Uniform": Law(_uniform, lambda a, b: (a <= b) & np.isfinite(b - a), (0.0, 0.0), "f", UNIFORM),
    "Bernoulli": Law(lambda u, p: u <= p, _probability, (0.0,), "b", UNIFORM),
    "Normal": Law(
        _normal,
        lambda m, v: (v >= 0) & np.ones(np.shape(m), bool),
        (0.0, 0.0),
        "f",
        "standard_normal",
    ),
    "Poisson": Law(
        lambda g, n, m: g.poisson(m, n), lambda m: (m >= 0) & (m <= _LARGEST_RATE), (0.0,), "i"
    ),
    "Exponential": Law(lambda e, m: m * e, _positive, (1.0,), "f", "standard_exponential"),
    "Weibull": Law(lambda g, n, k, m: m * g.weibull(k, n), _positive, _ONES),
    "Gamma": Law(lambda g, n, k, m: m * g.standard_gamma(k, n), _positive, _ONES),
    "Binomial": Law(
        lambda g, n, count, p: g.binomial(count, p, n),
        lambda count, p: (count >= 0) & _probability(p),
        (0, 0.0),
        "i",
    ),
    "NegativeBinomial": Law(
        lambda g, n, count, p: g.negative_binomial(count, p, n),
        lambda count, p: (count > 0) & (p > 0) & (p <= 1),
        (1, 1.0),
        "i",
    ),
    "Beta": Law(lambda g, n, a, b: g.beta(a, b, n), _positive, _ONES),
    "Geometric": Law(lambda g, n, p: g.geometric(p, n), lambda p: (p > 0) & (p <= 1), (1.0,), "i"),
    "Pareto": Law(lambda g, n, k, m: m * g.pareto(k, n), _positive, _ONES),
    "Student": Law(lambda g, n, df: g.standard_t(df, n), _positive, (1.0,)),
    "Gumbel": Law(lambda g, n, m, s: g.gumbel(m, s, n), _second_positive, (0.0, 1.0)),
    "Laplace": Law(lambda g, n, m, s: g.laplace(m, s, n), _second_positive, (0.0, 1.0)),
    "Cauchy": Law(lambda g, n, m, s: m + s * g.standard_cauchy(n), _second_positive, (0.0, 1.0)),
    "Gompertz": Law(_gompertz, _positive, _ONES, "f", UNIFORM),
    "ChiSquare": Law(lambda g, n, df: g.chisquare(df, n), _positive, (1.0,)),
    "Kumaraswamy": Law(_kumaraswamy, _positive, _ONES, "f", UNIFORM),
}


def sums_to_one(total: Any) -> Any:
    """Whether probabilities may count as summing to 1, as `numpy.allclose` has it."""
    return np.abs(total - 1.0) <= 1e-8 + 1e-5
