"""The simulator against pyRDDLGym's environment, on every problem of rddlrepository.

Step by step, under random actions and under the no-op, both draw from a generator that gives the
same quantile at every call, whatever the order of the calls: then observation, reward, legality,
end and error have to be equal. Where something is drawn, the means over 1,024 replicas of the
return and of each fluent at the end have to agree with those over episodes of the environment.

Errors of pyRDDLGym's `pow` in the last bit are the only difference: it raises to a constant power
by an array of exponents, and `numpy` by multiplication where the exponent is one number.
"""

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pyRDDLGym import RDDLEnv
from pyRDDLGym.core.debug.exception import RDDLInvalidActionError
from rddlrepository.core.manager import RDDLRepoManager
from scipy import stats

from benchmarks.common.records import Records
from mdpo_rddl.machine.versions import versions
from mdpo_rddl.problem.load import Problem, load_problem, make_environment
from mdpo_rddl.simulator.simulator import Simulator

QUANTILES = (0.5, 0.1, 0.9)
_EPISODES_SIDE_BY_SIDE = 3
# of a problem's steps: what is equal so long is equal
_MOST_STEPS = 40
_SECONDS = 2.0
# relative; above it a difference is none of rounding
_ROUNDING = 1e-14
_REPLICAS, _EPISODES, _MEAN_STEPS, _MEAN_SECONDS = 1024, 200, 20, 6.0
_STANDARD_ERRORS = 4.0
# an unbounded number is drawn this far from the finite end of its box
_REACH = 10.0


class QuantileGenerator:
    """Stands in for numpy's generator: every draw is the same quantile of its law.

    Attributes:
      quantile: the quantile.
      calls: how many draws were asked for.
    """

    def __init__(self, quantile: float) -> None:
        self.quantile, self.calls = quantile, 0

    def _as(self, value: Any, size: Any = None) -> Any:
        self.calls += 1
        value = np.asarray(value)
        return value[()] if size is None else np.broadcast_to(value, size).copy()

    def _whole(self, value: Any, size: Any = None) -> Any:
        return self._as(np.asarray(value).astype(np.int64), size)

    def random(self, size: Any = None) -> Any:
        """Uniform on [0, 1)."""
        return self._as(self.quantile, size)

    def uniform(self, low: Any = 0.0, high: Any = 1.0, size: Any = None) -> Any:
        """Uniform."""
        return self._as(low + (np.asarray(high) - low) * self.quantile, size)

    def standard_normal(self, size: Any = None, dtype: Any = float) -> Any:
        """Standard normal."""
        return self._as(stats.norm.ppf(self.quantile), size)

    def normal(self, loc: Any, scale: Any) -> Any:
        """Normal, of a standard deviation."""
        return self._as(np.asarray(loc) + np.asarray(scale) * stats.norm.ppf(self.quantile))

    def standard_exponential(self, size: Any = None) -> Any:
        """Exponential of mean 1."""
        return self._as(-math.log1p(-self.quantile), size)

    def exponential(self, scale: Any) -> Any:
        """Exponential."""
        return self._as(scale * -math.log1p(-self.quantile))

    def poisson(self, lam: Any, size: Any = None) -> Any:
        """Poisson."""
        return self._whole(stats.poisson.ppf(self.quantile, lam), size)

    def weibull(self, a: Any, size: Any = None) -> Any:
        """Weibull of scale 1."""
        return self._as(stats.weibull_min.ppf(self.quantile, a), size)

    def standard_gamma(self, shape: Any, size: Any = None) -> Any:
        """Gamma of scale 1."""
        return self._as(stats.gamma.ppf(self.quantile, shape), size)

    def gamma(self, shape: Any, scale: Any) -> Any:
        """Gamma."""
        return self._as(scale * stats.gamma.ppf(self.quantile, shape))

    def binomial(self, n: Any, p: Any, size: Any = None) -> Any:
        """Binomial."""
        return self._whole(stats.binom.ppf(self.quantile, n, p), size)

    def negative_binomial(self, n: Any, p: Any, size: Any = None) -> Any:
        """Negative binomial."""
        return self._whole(stats.nbinom.ppf(self.quantile, n, p), size)

    def beta(self, a: Any, b: Any, size: Any = None) -> Any:
        """Beta."""
        return self._as(stats.beta.ppf(self.quantile, a, b), size)

    def geometric(self, p: Any, size: Any = None) -> Any:
        """Geometric."""
        return self._whole(stats.geom.ppf(self.quantile, p), size)

    def pareto(self, a: Any, size: Any = None) -> Any:
        """Pareto of the second kind, which begins at 0."""
        return self._as(stats.lomax.ppf(self.quantile, a), size)

    def standard_t(self, df: Any, size: Any = None) -> Any:
        """Student's t."""
        return self._as(stats.t.ppf(self.quantile, df), size)

    def gumbel(self, loc: Any, scale: Any, size: Any = None) -> Any:
        """Gumbel."""
        return self._as(stats.gumbel_r.ppf(self.quantile, loc, scale), size)

    def laplace(self, loc: Any, scale: Any, size: Any = None) -> Any:
        """Laplace."""
        return self._as(stats.laplace.ppf(self.quantile, loc, scale), size)

    def standard_cauchy(self, size: Any = None) -> Any:
        """Cauchy."""
        return self._as(stats.cauchy.ppf(self.quantile), size)

    def chisquare(self, df: Any, size: Any = None) -> Any:
        """Chi-square."""
        return self._as(stats.chi2.ppf(self.quantile, df), size)

    def multinomial(self, n: Any, pvals: Any) -> Any:
        """Counts in proportion to the probabilities, the rest in the first class."""
        counts = np.floor(np.asarray(n)[..., None] * np.asarray(pvals)).astype(np.int64)
        counts[..., 0] += np.asarray(n) - counts.sum(axis=-1)
        return self._as(counts)


class Comparison(NamedTuple):
    """What episodes of both have come to.

    Attributes:
      steps: that were compared.
      draws: whether anything was drawn.
      rounding: the largest relative difference of a number.
      differences: what differs by more than rounding, in words.
    """

    steps: int
    draws: bool
    rounding: float
    differences: list[str]


def random_actions(env: RDDLEnv, generator: np.random.Generator) -> dict[str, np.ndarray]:
    """Random values in their boxes for as many ground actions as `max-nondef-actions` allows."""
    model = env.model
    actions = {name: np.array(value) for name, value in env.sampler.noop_actions.items()}
    places = [(name, i) for name, value in actions.items() for i in np.ndindex(value.shape)]
    most = min(model.max_allowed_actions, len(places))
    chosen = generator.permutation(len(places))[: generator.integers(most + 1)]
    for name, index in (places[number] for number in chosen):
        kind, space = model.action_ranges[name], env.action_space[name]
        low, high = (
            float(np.reshape(end, actions[name].shape)[index]) for end in (space.low, space.high)
        )
        low = max(low, min(high, _REACH) - _REACH)
        high = min(high, low + _REACH)
        drawn = (
            generator.uniform(low, high)
            if kind == "real"
            else generator.integers(int(low), int(high) + 1)
        )
        actions[name][index] = drawn
    return actions


def compare(problem: Problem, quantile: float, is_random: bool, seed: int = 0) -> Comparison:
    """Plays a few episodes of both, side by side, with the same quantile at each draw."""
    count = _EPISODES_SIDE_BY_SIDE
    simulator, mine = Simulator(problem), QuantileGenerator(quantile)
    envs = [make_environment(problem) for _ in range(count)]
    for env in envs:
        env.reset()
        env.sampler.rng = QuantileGenerator(quantile)
    generator, state = np.random.default_rng(seed), simulator.initial(count)
    alive, steps, started = [not env.done for env in envs], 0, time.monotonic()
    found = _Differences()
    if list(simulator.ended(state)) != [env.done for env in envs]:
        found.words.append("the initial state's end")
    for step in range(min(problem.horizon, _MOST_STEPS)):
        if not any(alive) or time.monotonic() - started > _SECONDS:
            break
        played = [
            random_actions(env, generator) if is_random else dict(env.sampler.noop_actions)
            for env in envs
        ]
        actions = {name: np.stack([p[name] for p in played], axis=-1) for name in played[0]}
        legal, after = simulator.legal(state, actions), simulator.step(state, actions, mine)
        is_last = step + 1 == problem.horizon
        for number, env in enumerate(envs):
            if alive[number]:
                steps += 1
                one = _Replica(simulator, after, bool(legal[number]), number)
                alive[number] = found.add(env, played[number], one, step, is_last)
        state = after.state
    return Comparison(steps, mine.calls > 0, found.rounding, found.words)


class _Replica(NamedTuple):
    simulator: Simulator
    after: Any
    legal: bool
    number: int


class _Differences:
    def __init__(self) -> None:
        self.rounding, self.words = 0.0, list[str]()

    def add(
        self, env: RDDLEnv, actions: Mapping[str, Any], one: _Replica, step: int, is_last: bool
    ) -> bool:
        """Compares a step; whether the episode goes on."""
        if env.sampler.check_action_preconditions(dict(actions), silent=True) != one.legal:
            self.words.append(f"legality at step {step}")
        after, number = one.after, one.number
        try:
            observed, reward, terminated, truncated, _ = env.step(actions)
        except RDDLInvalidActionError:
            raise
        except Exception as error:  # pyRDDLGym's and numpy's have no common base
            if not after.errors[number]:
                self.words.append(f"no {type(error).__name__} at step {step}")
            return False
        if after.errors[number]:
            self.words.append(f"an error at step {step}")
        if bool(after.terminated[number]) != terminated:
            self.words.append(f"termination at step {step}")
        if not is_last and bool(after.broken[number]) != truncated:
            self.words.append(f"invariants at step {step}")
        self._numbers("reward", step, after.rewards[number], reward)
        values = one.simulator.observation(after.state)
        for name, value in observed.items():
            ours = values[name][..., number]
            self._numbers(name, step, ours, _indices(env, name, value).reshape(ours.shape))
        return not (terminated or truncated)

    def _numbers(self, name: str, step: int, ours: Any, theirs: Any) -> None:
        x, y = np.asarray(ours, float), np.asarray(theirs, float)
        differs = ~((x == y) | (np.isnan(x) & np.isnan(y)))
        if differs.any():
            gap = np.abs(x - y)[differs] / np.maximum(np.abs(x), np.abs(y))[differs]
            largest = float(np.max(np.where(np.isfinite(gap), gap, np.inf)))
            self.rounding = max(self.rounding, largest)
            if largest > _ROUNDING:
                self.words.append(f"{name} at step {step} by {largest:.2g}")


def _indices(env: RDDLEnv, name: str, value: Any) -> np.ndarray:
    """Objects as their indices."""
    array = np.asarray(value)
    if array.dtype.kind in "UO":
        array = np.vectorize(env.model.object_to_index.get, otypes=[int])(array)
    return array


def furthest_mean(problem: Problem, seed: int = 0) -> tuple[str, float]:
    """The return or fluent whose means differ most, and by how many standard errors.

    One sequence of random actions is played in 1,024 replicas, and in episodes of the environment.
    """
    env, simulator = make_environment(problem), Simulator(problem)
    generator = np.random.default_rng(seed)
    env.reset(seed=seed)
    plan = [random_actions(env, generator) for _ in range(min(problem.horizon, _MEAN_STEPS))]
    ours, theirs = _ours(simulator, plan, generator), _theirs(env, simulator, plan)
    worst, largest = "", 0.0
    for name, values in ours.items():
        x, y = values[np.isfinite(values)], np.asarray(theirs[name], float)
        y = y[np.isfinite(y)]
        if len(x) < 2 or len(y) < 2:
            continue
        error = math.sqrt(np.var(x, ddof=1) / len(x) + np.var(y, ddof=1) / len(y))
        gap = abs(float(np.mean(x) - np.mean(y)))
        if gap <= 1e-9 * max(1.0, abs(float(np.mean(y)))):
            continue
        # an environment that is always the same has the accuracy of one in so many episodes
        if error == 0:
            error = gap if gap < 3.0 / len(y) else 1e-9
        if gap / error > largest:
            worst, largest = name, gap / error
    return worst, largest


def _ours(
    simulator: Simulator, plan: list[dict[str, Any]], generator: np.random.Generator
) -> dict[str, np.ndarray]:
    state = simulator.initial(_REPLICAS)
    alive, total = ~simulator.ended(state), np.zeros(_REPLICAS)
    last = {n: v.mean(axis=tuple(range(v.ndim - 1))) for n, v in _seen(simulator, state).items()}
    for actions in plan:
        columns = {name: np.asarray(value)[..., None] for name, value in actions.items()}
        after = simulator.step(state, columns, generator)
        alive &= ~after.errors
        total[alive] += after.rewards[alive]
        for name, value in _seen(simulator, after.state).items():
            mean = value.astype(float).mean(axis=tuple(range(value.ndim - 1)))
            last[name] = np.where(alive, mean, last[name])
        alive &= ~(after.terminated | after.broken)
        state = after.state
    return {"the return": total, **last}


def _seen(simulator: Simulator, state: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: state[name] for name in simulator.problem.model.state_fluents}


def _theirs(
    env: RDDLEnv, simulator: Simulator, plan: list[dict[str, Any]]
) -> dict[str, list[float]]:
    names = list(simulator.problem.model.state_fluents)
    values: dict[str, list[float]] = {name: [] for name in ["the return", *names]}
    started = time.monotonic()
    for episode in range(_EPISODES):
        if time.monotonic() - started > _MEAN_SECONDS:
            break
        env.reset(seed=10_000 + episode)
        total = 0.0
        state = dict(env.state)
        for actions in plan:
            if env.done:
                break
            try:
                total += env.step(actions)[1]
            except RDDLInvalidActionError:
                raise
            except Exception:  # an error ends the episode in both
                break
            state = dict(env.state)
        values["the return"].append(total)
        for name in names:
            values[name].append(float(np.mean(_indices(env, name, state[name]))))
    return values


def law_row(problem: Problem) -> dict[str, Any]:
    """What was compared on a problem, and what differs."""
    steps, draws, rounding, words = 0, False, 0.0, list[str]()
    for quantile in QUANTILES:
        for is_random in (True, False):
            found = compare(problem, quantile, is_random)
            steps, rounding = steps + found.steps, max(rounding, found.rounding)
            draws, words = draws or found.draws, words + found.differences
        if not draws:
            break
    name, errors = furthest_mean(problem) if draws else ("", 0.0)
    if errors > _STANDARD_ERRORS:
        words.append(f"the mean of {name} by {errors:.1f} standard errors")
    return {
        "steps": steps,
        "draws": draws,
        "rounding": f"{rounding:.2g}",
        "mean": name,
        "standard_errors": round(errors, 2),
        "differences": "; ".join(words[:3]),
    }


def every_problem() -> Iterable[tuple[str, str]]:
    """Each problem of rddlrepository with its first instance."""
    manager = RDDLRepoManager()
    for name in sorted(manager.list_problems()):
        yield name, manager.get_problem(name).list_instances()[0]


def law_table(rows: Sequence[Mapping[str, str]]) -> str:
    """Markdown: what was compared on each problem, and what differs."""
    exact = sum(row["rounding"] == "0" and not row["differences"] for row in rows)
    fine = sum(not row["differences"] for row in rows)
    lines = [
        f"Of {len(rows)} problems {exact} are equal to the last bit, and {fine} but for rounding "
        f"below {_ROUNDING:g}.",
        "",
        "| problem | instance | steps | draws | rounding | furthest mean | differences |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        mean = row["mean"] and f"{row['mean']}, {row['standard_errors']} standard errors"
        cells = (row["problem"], row["instance"], row["steps"], row["draws"], row["rounding"])
        lines.append("| " + " | ".join([*map(str, cells), mean, row["differences"]]) + " |")
    return "\n".join(lines) + "\n"


def run_law(out: Path, problems: Iterable[str] | None) -> Records:
    """Compares all problems, or these, with rows as they come.

    Args:
      out: results folder; rows that it holds stay.
      problems: names of rddlrepository; all of it if None.
    """
    columns = ("steps", "draws", "rounding", "mean", "standard_errors", "differences")
    keys = ("problem", "instance")
    records = Records(out / "rows.csv", (*keys, *columns), keys, {"versions": versions()})
    for name, instance in every_problem():
        if (problems is None or name in problems) and not records.has(name, instance):
            row = law_row(load_problem(name, instance))
            records.add(name, instance, *(row[column] for column in columns))
    return records
