"""Says what a policy does, as an equation for each action fluent."""

import html
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from mdpo_rddl.planner.exact.exact import exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.policy.rule.terms import Term, raw_unit, terms_of
from mdpo_rddl.policy.rule.visits import visited_states
from mdpo_rddl.problem.load import Problem

_ROLLOUTS = 128
_NO_RULE = "the policy is no lifted rule, so there is no equation to write"


@dataclass(frozen=True)
class ExplainedTerm:
    """A term of an equation.

    Attributes:
      text: as it stands there, in the domain's names and units.
      is_shared: whether it is one weight for all objects.
      size: root mean square over the states of an episode and the objects, in the action's unit.
      cost: mean return that is lost without it on the exact model, the same rollouts with and
        without; None if it was not measured.
      cost_error: standard error of the cost.
    """

    text: str
    is_shared: bool
    size: float
    cost: float | None = None
    cost_error: float | None = None


@dataclass(frozen=True)
class Equation:
    """The rule of one action fluent: the no-op plus its terms, within bounds.

    Attributes:
      action: the fluent's name.
      head: the equation's left side and what comes before the terms.
      within: what is made of the sum.
      terms: the largest first.
    """

    action: str
    head: str
    within: str
    terms: tuple[ExplainedTerm, ...]


@dataclass(frozen=True)
class Explanation:
    """A policy in words.

    Attributes:
      equations: one for each action fluent; none where the policy is no lifted rule.
      note: what there is to say beside them.
    """

    equations: tuple[Equation, ...]
    note: str

    def to_json(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return asdict(self)

    def __str__(self) -> str:
        lines = []
        for equation in self.equations:
            lines.append(equation.head)
            lines += [f"    {term.text}{_measured(term)}" for term in equation.terms]
            lines.append(f"  {equation.within}")
        return "\n".join([*lines, self.note])

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"


def is_compiled(planner: MDPOPlanner) -> bool:
    """Whether what measures the costs of terms is compiled already."""
    return _ROLLOUTS in planner.exact_programs


def explain(
    problem: Problem,
    planner: MDPOPlanner,
    params: Params,
    seconds: float = np.inf,
    clock: Callable[[], float] = time.monotonic,
) -> Explanation:
    """Writes a feedback policy's rule as equations.

    Args:
      problem: that the policy plays.
      planner: compiled for the policy's configuration.
      params: of the policy.
      seconds: after which no further cost is measured; 0 measures none. The largest terms come
        first.
      clock: tells the seconds.
    """
    plan = planner.plan
    if not isinstance(plan, FeedbackPlan):
        return Explanation((), _NO_RULE)
    terms = terms_of(plan, params)
    sizes = _sizes(problem, planner, params, terms)
    order = sorted(range(len(terms)), key=lambda number: -sizes[number])
    costs = _costs(planner, params, [terms[number] for number in order], clock() + seconds, clock)
    explained: dict[str, list[ExplainedTerm]] = {name: [] for name in plan.feedback.action_shapes}
    for number, cost in zip(order, costs, strict=True):
        term = terms[number]
        entry = ExplainedTerm(term.text, term.is_shared, sizes[number], *cost)
        explained[term.action].append(entry)
    equations = tuple(
        _equation(plan, planner, name, tuple(entries)) for name, entries in explained.items()
    )
    return Explanation(equations, _note(planner))


def _sizes(
    problem: Problem, planner: MDPOPlanner, params: Params, terms: list[Term]
) -> list[float]:
    """Root mean square of what each term adds to its action, in the action's unit.

    Zeros where nothing was observed.
    """
    plan = planner.feedback_plan
    states = visited_states(problem, planner, params)
    if plan.feedback.seen and not states:
        return [0.0] * len(terms)
    steps = jnp.arange(len(next(iter(states.values()))) if states else 1)

    @jax.jit
    def raws(each: Params) -> Mapping[str, Any]:
        # one state after the other: there may be many objects
        return lax.map(lambda seen: plan.feedback.raw(each, *seen), (states, steps))

    whole, sizes = raws(params), []
    for term in terms:
        added = np.asarray(whole[term.action] - raws(term.params)[term.action], float)
        size = raw_unit(plan, term.action) * float(np.sqrt(np.mean(added**2)))
        # without a term the rule may overflow
        sizes.append(size if np.isfinite(size) else 0.0)
    return sizes


def _costs(
    planner: MDPOPlanner,
    params: Params,
    terms: list[Term],
    until: float,
    clock: Callable[[], float],
) -> list[tuple[float, float] | tuple[None, None]]:
    """What the return loses without each term, and its standard error."""
    if clock() >= until:
        return [(None, None)] * len(terms)
    key = jax.random.PRNGKey(0)
    play = exact_returns(planner, _ROLLOUTS)

    def returns(each: Params) -> np.ndarray:
        one = jax.tree.map(lambda leaf: jnp.asarray(leaf)[jnp.newaxis], each)
        return np.asarray(play(key, one), float)[0]

    whole = returns(params)
    costs: list[tuple[float, float] | tuple[None, None]] = []
    for term in terms:
        if clock() >= until:
            costs.append((None, None))
            continue
        lost = whole - returns(term.params)
        cost = float(np.mean(lost)), float(np.std(lost) / np.sqrt(len(lost)))
        # without a term the model may diverge
        costs.append(cost if np.all(np.isfinite(cost)) else (None, None))
    return costs


def _equation(
    plan: FeedbackPlan, planner: MDPOPlanner, name: str, terms: tuple[ExplainedTerm, ...]
) -> Equation:
    rddl = planner.rddl
    arguments = ", ".join(f"?{kind}" for kind in rddl.variable_params[name])
    left = f"{name}({arguments})" if arguments else name
    noop = np.asarray(planner.compiled.init_values[name], float)
    if name not in plan.units:
        other = "false" if np.any(noop) else "true"
        return Equation(name, f"{left} is {other} if 0 <", "", terms)
    start = f"{noop.min():.4g}" if noop.min() == noop.max() else "its default"
    low, high = (np.asarray(bound, float) for bound in plan.bounds[name])
    is_bounded = bool(np.any(np.isfinite(low)) or np.any(np.isfinite(high)))
    within = f"clipped to [{_bound(low)}, {_bound(high)}]" if is_bounded else "without bounds"
    rounded = "" if rddl.variable_ranges[name] == "real" else ", rounded"
    return Equation(name, f"{left} = {start}", within + rounded, terms)


def _bound(values: np.ndarray) -> str:
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}, by object"


def _note(planner: MDPOPlanner) -> str:
    relations = any(
        " from " in feature.name or " to " in feature.name
        for found in planner.feedback_plan.feedback.features.values()
        for feature in found.state
    )
    note = "a fluent of other objects than the action's stands for its mean over them"
    if relations:
        note += (
            "; 'f from R' is the mean of f over the objects y of R(x, y), 'f to R' of R(y, x); "
            "of two relations the last one is the first step"
        )
    if planner.memory.initial:
        note += (
            "; 'last f' and 'mean of f over N steps' are of earlier steps, an action counting from "
            "its no-op in its unit; 'trace of f over N steps' is exp(-n / N), f true n steps ago"
        )
    return note


def _measured(term: ExplainedTerm) -> str:
    text = f"    size {term.size:.3g}"
    if term.cost is None or term.cost_error is None:
        return text
    return text + f", without it {-term.cost:+.4g} (error {term.cost_error:.2g})"
