"""The recipe of the preset `auto`: probe, search, follow the gradient, choose.

1. Constant actions on the exact model say in which units states and actions are of order 1.
2. The few weights that all objects share are searched for without a gradient on the exact
   return, which neither flat regions nor cliffs stop; then each object's own weights.
3. MDPO follows the relaxed model's gradient from there and from the best constant action, with
   several step sizes side by side, in phases, each from the best policy so far.
4. Another search around the best policy evens out what the relaxed model has wrong.
5. Meanwhile, in a second process, JaxPlan's default planners have their try.
6. Whatever earns most in fresh exact rollouts is the result.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.auto.alternatives import Alternatives
from mdpo_rddl.auto.descent import Descent, descend
from mdpo_rddl.auto.probing import Probe, probe, with_bias
from mdpo_rddl.auto.searching import Searched, search_feedback
from mdpo_rddl.feedback import Params
from mdpo_rddl.jaxplan.config import PlannerConfig
from mdpo_rddl.jaxplan.exact import compile_returns
from mdpo_rddl.jaxplan.planner import MDPOPlanner
from mdpo_rddl.jaxplan.search_section import Search
from mdpo_rddl.planning import build_planner
from mdpo_rddl.problem import Problem
from mdpo_rddl.training import Progress, TrainingResult

logger = logging.getLogger(__name__)

_CHOICE_ROLLOUTS, _FEW_ROLLOUTS = 128, 2
# of the time, for the rollouts of one population: the gradient's program is then too slow, too
_SLOW_SHARE = 0.01
_PROBING_SEED = 0
_POLISHING_SIGMA = 0.01
# a search of a large problem evaluates at least so many policies
_FEWEST_POLICIES = 30
# the second process may be late
_LATE_SECONDS = 5.0


@dataclass(frozen=True)
class AutoResult:
    """What the recipe found.

    Attributes:
      config: the configuration that the policy belongs to.
      planner: compiled for it.
      training: the policy and how it came about.
      diagnostics: what was chosen and why, as JSON can hold it.
    """

    config: PlannerConfig
    planner: MDPOPlanner
    training: TrainingResult
    diagnostics: dict[str, Any]


def plan_automatically(
    problem: Problem,
    config: PlannerConfig,
    *,
    seed: int,
    programs: Path | None = None,
    on_stage: Callable[[str], None] = lambda name: None,
    on_progress: Callable[[Progress], None] = lambda progress: None,
) -> AutoResult:
    """Finds a policy.

    Args:
      problem: the parsed problem.
      config: with a `FeedbackPlan` and a section `[Search]`; `[Optimize] train_seconds` is
        the time for everything, compilation included.
      seed: of everything that is drawn.
      programs: where traced programs are kept from one process to the next, if anywhere.
      on_stage: called with the name of each part as it begins.
      on_progress: called while the gradient part goes on.

    Raises:
      InputError: if JaxPlan refuses the problem or the configuration.
    """
    started = time.monotonic()
    seconds = config.section("Optimize")["train_seconds"]
    budget = Search(**config.section("Search"))
    config = config.without_section("Search")
    with Alternatives(problem, seed, seconds, wanted=budget.alternatives) as alternatives:
        on_stage("probing")
        # the same for all seeds, whose programs then are the same too
        bare, _ = build_planner(problem, without_scales(config))
        found = probe(bare, _PROBING_SEED, started + budget.shared_until * seconds)
        config = scaled(config, found)
        large = found.policy_seconds is not None
        if large:
            alternatives.stop()  # its memory is needed
            config = simplified(config)
        planner, _ = build_planner(problem, config, programs)
        params = planner.plan.initializer(jax.random.PRNGKey(seed), {}, None)
        constant = with_bias(params, found.start)
        choice = _Choice(planner, _FEW_ROLLOUTS if large else _CHOICE_ROLLOUTS, seed)
        searched, descent, last = None, Descent(), constant
        left = started + seconds - time.monotonic()
        if found.policy_seconds is not None and found.policy_seconds * _FEWEST_POLICIES > left:
            logger.warning("the problem is too large to search in %g s", seconds)
            choice.take("constant", constant, found.start_return, np.inf)
        else:
            choice.add("constant", constant)
            on_stage("searching")
            searched = search_feedback(
                planner,
                params,
                seed=seed,
                shared_until=started + budget.shared_until * seconds,
                own_until=started + budget.own_until * seconds,
            )
            choice.add("shared weights", searched.shared)
            choice.add("own weights", searched.params)
            if large or searched.evaluation_seconds > _SLOW_SHARE * seconds:
                logger.warning("the problem is too large for the gradient in %g s", seconds)
            else:
                on_stage("compiling")
                descent = descend(
                    planner,
                    [choice.best, constant],
                    choice,
                    key=jax.random.PRNGKey(seed),
                    deadline=started + budget.gradient_until * seconds,
                    on_progress=on_progress,
                )
            last, _ = searched.polish(choice.best, _POLISHING_SIGMA, started + seconds, seed)
            choice.add("polished", last)
        other = alternatives.best(until=started + seconds + _LATE_SECONDS)
    diagnostics = _diagnostics(found, searched, descent, choice)
    if other is not None:
        diagnostics["returns"][other.name] = other.mean
        if other.mean - choice.best_mean > 2.0 * np.hypot(other.error, choice.best_error):
            diagnostics["chosen"] = other.name
            return AutoResult(other.config, other.planner(problem), other.training, diagnostics)
    training = descent.result(choice.best, last, time.monotonic() - started)
    return AutoResult(config, planner, training, diagnostics)


def without_scales(config: PlannerConfig) -> PlannerConfig:
    """The configuration for probing: no net, states as they are, units of 1 without a box."""
    return simplified(config)


def simplified(config: PlannerConfig) -> PlannerConfig:
    """The configuration for a problem of many objects: no net, and few features."""
    return _with_plan(config, topology=[], cosines=0, squares=False)


def scaled(config: PlannerConfig, found: Probe) -> PlannerConfig:
    """The configuration with the scales that probing found."""
    scales = {name: [_short(value) for value in pair] for name, pair in found.state_scales.items()}
    units = {name: _short(value) for name, value in found.units.items()}
    return _with_plan(config, state_scales=scales, units=units)


def _with_plan(config: PlannerConfig, **values: Any) -> PlannerConfig:
    arguments = {**config.section("Planner").get("method_kwargs", {}), **values}
    return config.with_values("Planner", method_kwargs=arguments)


def _short(value: float) -> float:
    """Four digits are enough for a scale that people may read."""
    return float(f"{value:.4g}")


class _Choice:
    """The best policy so far, by fresh rollouts on the exact model that are the same for all.

    Attributes:
      best: its parameters.
      best_mean, best_error: mean return and standard error.
      name: where it came from.
      means: of all that were added, by name.
    """

    def __init__(self, planner: MDPOPlanner, rollouts: int, seed: int) -> None:
        side_by_side = None if rollouts > _FEW_ROLLOUTS else 1
        self._returns = compile_returns(planner, rollouts, side_by_side)
        self._key = jax.random.PRNGKey(seed + 1)
        self.best: Any = None
        self.best_mean, self.best_error = -np.inf, np.inf
        self.name = ""
        self.means: dict[str, float] = {}

    def add(self, name: str, params: Params) -> bool:
        """Whether the policy is the best so far."""
        one = jax.tree.map(lambda leaf: jnp.asarray(leaf)[jnp.newaxis], params)
        returns = np.asarray(self._returns(self._key, one), float)[0]
        error = float(np.std(returns) / np.sqrt(len(returns)))
        return self.take(name, params, float(np.mean(returns)), error)

    def take(self, name: str, params: Params, mean: float, error: float) -> bool:
        """As `add`, for a policy whose return is known."""
        self.means[name] = mean
        logger.info("%s: %.6g", name, mean)
        if self.best is not None and not mean > self.best_mean:
            return False
        self.best, self.name = params, name
        self.best_mean, self.best_error = mean, error
        return True


def _diagnostics(
    found: Probe, searched: Searched | None, descent: Descent, choice: _Choice
) -> dict[str, Any]:
    def finite(value: float) -> float | None:
        return value if np.isfinite(value) else None

    return {
        "chosen": choice.name,
        "returns": {
            "nothing": finite(found.nothing),
            **{name: finite(mean) for name, mean in choice.means.items()},
        },
        "units": found.units,
        "state_scales": {name: list(pair) for name, pair in found.state_scales.items()},
        "search_iterations": {
            "shared": searched.shared_iterations if searched else 0,
            "own": searched.own_iterations if searched else 0,
        },
        "phases": descent.summary(),
    }
