"""How near the race comes to the optimum of linear systems with quadratic costs, which is known.

    python tools/linear_quadratic.py ROWS SECONDS SEED [SYSTEM...]

Each of `SYSTEMS`, x' = A x + B u + w with w ~ N(0, sigma^2) and the cost |x|^2 + 0.1 |u|^2 of a
step, is written in RDDL twice: with objects, whose A and B are non-fluents, and with a fluent for
each entry of x and u. The race has SECONDS for each, then its policy plays `EPISODES` on the exact
environment. `lqr` is the mean return of the optimal gains, by Riccati's recursion, in the same
episodes, `optimum` what they return in expectation. Rows are added to ROWS. Run it on one core.
"""

import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rows import Rows

import mdpo_rddl as mdpo

EPISODES = 100
COLUMNS = (
    *("system", "form", "states", "inputs", "seconds", "seed", "optimum", "lqr", "mean"),
    *("difference", "error", "commit"),
)
_INPUT_COST = 0.1
# far from the seeds of races
_EPISODES_SEED = 2024


@dataclass(frozen=True, eq=False)
class System:
    """A linear system.

    Attributes:
      a: [n, n].
      b: [n, m].
      start: the state [n] at first.
      sigma: of the noise on each entry of the state, at each step.
      horizon: number of steps.
    """

    a: np.ndarray
    b: np.ndarray
    start: np.ndarray
    sigma: float
    horizon: int

    def gains(self) -> tuple[list[np.ndarray], float]:
        """The gains K [m, n] of u = -K x at each step, and the optimal expected return.

        Bertsekas (2017), Dynamic Programming and Optimal Control I, section 3.1.
        """
        cost, noise, gains = np.zeros_like(self.a), 0.0, list[np.ndarray]()
        inputs = _INPUT_COST * np.eye(self.b.shape[1])
        for _ in range(self.horizon):
            gain = np.linalg.solve(inputs + self.b.T @ cost @ self.b, self.b.T @ cost @ self.a)
            noise += self.sigma**2 * np.trace(cost)
            cost = np.eye(len(self.a)) + self.a.T @ cost @ (self.a - self.b @ gain)
            gains.insert(0, gain)
        return gains, -float(self.start @ cost @ self.start + noise)


def _double_integrator() -> System:
    a, b = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.0], [0.1]])
    return System(a, b, np.array([1.0, 0.0]), 0.02, 60)


def _pendulum_on_a_cart(step: float = 0.05) -> System:
    """About the upright pole of 0.1 kg and 0.5 m on a cart of 1 kg; place, speed, angle, rate."""
    a = np.eye(4)
    a[0, 1] = a[2, 3] = step
    a[1, 2], a[3, 2] = -0.981 * step, 21.58 * step
    b = np.array([[0.0], [step], [0.0], [-2.0 * step]])
    return System(a, b, np.array([0.5, 0.0, 0.1, 0.0]), 0.01, 80)


def _masses(count: int = 5, step: float = 0.05) -> System:
    """A chain of masses on springs, with a force on the first and on the last."""
    a, b = np.eye(2 * count), np.zeros((2 * count, 2))
    for mass in range(count):
        speed = count + mass
        a[mass, speed] = step
        a[speed, speed] -= 0.1 * step
        for other in {mass - 1, mass + 1} & set(range(count)):
            a[speed, other] += 2.0 * step
            a[speed, mass] -= 2.0 * step
    b[count, 0] = b[2 * count - 1, 1] = 3.0 * step
    return System(a, b, np.r_[np.linspace(1.0, -1.0, count), np.zeros(count)], 0.05, 100)


def _dense(states: int, inputs: int, seed: int) -> System:
    """Every entry acts on every other one; slightly unstable."""
    random = np.random.default_rng(seed)
    a = random.normal(size=(states, states))
    a *= 1.02 / np.abs(np.linalg.eigvals(a)).max()
    b = 0.5 * random.normal(size=(states, inputs))
    return System(a, b, random.normal(size=states), 0.1, 40)


SYSTEMS: dict[str, Callable[[], System]] = {
    "double integrator": _double_integrator,
    "pendulum on a cart": _pendulum_on_a_cart,
    "five masses": _masses,
    "dense, 8 states": lambda: _dense(8, 3, 2),
    "dense, 16 states": lambda: _dense(16, 4, 3),
}


def with_objects(system: System) -> str:
    """The problem in RDDL, with an object for each entry of the state and of the input."""
    places, inputs = (
        [f"{letter}{number}" for number in range(count)]
        for letter, count in zip("pc", system.b.shape, strict=True)
    )
    given = [
        f"{name}({places[i]}, {others[k]}) = {float(value)!r};"
        for name, matrix, others in (("A", system.a, places), ("B", system.b, inputs))
        for (i, k), value in np.ndenumerate(matrix)
    ]
    start = [f"x({i}) = {float(v)!r};" for i, v in zip(places, system.start, strict=True)]
    return f"""
domain linear {{
  types {{ place: object; input: object; }};
  pvariables {{
    A(place, place) : {{ non-fluent, real, default = 0.0 }};
    B(place, input) : {{ non-fluent, real, default = 0.0 }};
    x(place)        : {{ state-fluent, real, default = 0.0 }};
    u(input)        : {{ action-fluent, real, default = 0.0 }};
  }};
  cpfs {{
    x'(?i) = (sum_{{?k : place}} [A(?i, ?k) * x(?k)]) + (sum_{{?j : input}} [B(?i, ?j) * u(?j)])
      + Normal(0.0, {system.sigma**2!r});
  }};
  reward = -((sum_{{?i : place}} [x(?i) * x(?i)])
    + {_INPUT_COST} * (sum_{{?j : input}} [u(?j) * u(?j)]));
}}
non-fluents given {{
  domain = linear;
  objects {{ place : {{{", ".join(places)}}}; input : {{{", ".join(inputs)}}}; }};
  non-fluents {{ {" ".join(given)} }};
}}
instance one {{
  domain = linear;
  non-fluents = given;
  init-state {{ {" ".join(start)} }};
  {_ending(system)}
}}
"""


def with_scalars(system: System) -> str:
    """The problem in RDDL, with a fluent for each entry of the state and of the input."""
    states = [f"x{number}" for number in range(system.b.shape[0])]
    inputs = [f"u{number}" for number in range(system.b.shape[1])]
    declared = [
        f"{name} : {{ state-fluent, real, default = {float(value)!r} }};"
        for name, value in zip(states, system.start, strict=True)
    ]
    declared += [f"{name} : {{ action-fluent, real, default = 0.0 }};" for name in inputs]
    changes = [
        f"{name}' = {_sum(row, [*states, *inputs])} + Normal(0.0, {system.sigma**2!r});"
        for name, row in zip(states, np.hstack([system.a, system.b]), strict=True)
    ]
    costs = [1.0] * len(states) + [_INPUT_COST] * len(inputs)
    squares = [f"{name} * {name}" for name in (*states, *inputs)]
    return f"""
domain linear {{
  pvariables {{ {" ".join(declared)} }};
  cpfs {{ {" ".join(changes)} }};
  reward = -({_sum(costs, squares)});
}}
non-fluents given {{ domain = linear; }}
instance one {{ domain = linear; non-fluents = given; {_ending(system)} }}
"""


def _ending(system: System) -> str:
    return f"max-nondef-actions = pos-inf; horizon = {system.horizon}; discount = 1.0;"


def _sum(factors: Iterable[float], terms: Sequence[str]) -> str:
    pairs = zip(factors, terms, strict=True)
    return " + ".join(f"({float(factor)!r}) * {term}" for factor, term in pairs if factor)


FORMS = {"objects": with_objects, "scalars": with_scalars}


def optimal_policy(gains: Sequence[np.ndarray], form: str) -> Callable[..., dict[str, Any]]:
    """What plays the optimal gains in one of `FORMS`."""

    def policy(step: int, state: Mapping[str, Any]) -> dict[str, Any]:
        if form == "objects":
            return {"u": -gains[step] @ state["x"]}
        seen = np.array([np.ravel(state[f"x{i}"])[0] for i in range(gains[step].shape[1])])
        return {f"u{number}": value for number, value in enumerate(-gains[step] @ seen)}

    return policy


def measured(system: System, form: str, seconds: float, seed: int) -> dict[str, Any]:
    """The figures of a row."""
    gains, optimum = system.gains()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "linear.rddl"
        path.write_text(FORMS[form](system))
        policy = mdpo.plan(str(path), seconds=seconds, seed=seed, progress=False)
        env = mdpo.make_environment(mdpo.load_problem(str(path)))
        ours, best = (
            mdpo.evaluate(env, each, EPISODES, _EPISODES_SEED).returns
            for each in (policy, optimal_policy(gains, form))
        )
    differences = ours - best
    error = differences.std(ddof=1) / np.sqrt(EPISODES)
    found = {"optimum": optimum, "lqr": best.mean(), "mean": ours.mean()}
    found |= {"difference": differences.mean(), "error": error}
    return {name: f"{value:.5g}" for name, value in found.items()}


def main() -> None:
    """Adds the rows."""
    path, seconds, seed, *systems = sys.argv[1:]
    rows = Rows(path, COLUMNS)
    for name in systems or SYSTEMS:
        system = SYSTEMS[name]()
        states, inputs = system.b.shape
        for form in FORMS:
            found = measured(system, form, float(seconds), int(seed))
            head = {"system": name, "form": form, "states": states, "inputs": inputs}
            row = head | {"seconds": seconds, "seed": seed} | found
            print(*row.values(), flush=True)
            rows.add(row)


if __name__ == "__main__":
    main()
