"""Says what a policy does, as an equation for each action fluent."""

import html
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.policy.formula import FeedbackFormula
from mdpo_rddl.policy.rule.terms import Term, raw_unit, terms_of
from mdpo_rddl.simulator.rollouts import rollout

NO_RULE = "the policy is no lifted rule, so there is no equation to write"

_ROLLOUTS = 128
# of the episode over which sizes are taken
_MOST_STEPS = 64
# parts of the parameters that are one policy's
_LAYERS = ("lifted", "net")


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


def explain(
    formula: FeedbackFormula,
    params: Params,
    seconds: float = np.inf,
    clock: Callable[[], float] = time.monotonic,
) -> Explanation:
    """Writes a feedback policy's rule as equations.

    Args:
      formula: of the policy's problem and configuration.
      params: of the policy.
      seconds: after which no further cost is measured; 0 measures none. The largest terms come
        first.
      clock: tells the seconds.
    """
    terms = terms_of(formula.actions, params)
    sizes = _sizes(formula, params, terms)
    order = sorted(range(len(terms)), key=lambda number: -sizes[number])
    until = clock() + seconds
    costs = _costs(formula, params, [terms[number] for number in order], until, clock)
    explained: dict[str, list[ExplainedTerm]] = {name: [] for name in formula.actions.noop}
    for number, cost in zip(order, costs, strict=True):
        term = terms[number]
        entry = ExplainedTerm(term.text, term.is_shared, sizes[number], *cost)
        explained[term.action].append(entry)
    equations = tuple(
        _equation(formula, name, tuple(entries)) for name, entries in explained.items()
    )
    return Explanation(equations, _note(formula))


def _returns(
    formula: FeedbackFormula,
    params: Params,
    episodes: int,
    seen: Callable[[int, Mapping[str, Any]], object] = lambda step, state: None,
) -> np.ndarray:
    """Returns of a policy, in episodes that are the same for all policies [episodes].

    NaN where the environment would have raised an error.

    Args:
      formula: plays the policy.
      params: of the policy.
      episodes: how many.
      seen: is told of each step and what the policy sees at it.
    """
    play = formula.replicas(params)

    def policy(step: int, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        actions = play(step, observation)
        seen(step, {**observation, **play.memory})
        play.were_played(actions)
        return actions

    found = rollout(formula.simulator, policy, episodes, seed=0)
    return np.where(found.errors, np.nan, found.returns)


def _sizes(formula: FeedbackFormula, params: Params, terms: Sequence[Term]) -> list[float]:
    """Root mean square of what each term adds to its action, in the action's unit.

    Over steps of one episode and the objects, from the first step at which anything is observed;
    zeros where nothing was.
    """
    raw, model = formula.actions.feedback.raw, formula.simulator.problem.model
    stride = -(-model.horizon // _MOST_STEPS)
    # of replicas each may have shared and own weights of its own, but no layers
    alike = [
        n for n, t in enumerate(terms) if all(t.params.get(p) is params.get(p) for p in _LAYERS)
    ]
    side_by_side = _stacked([params, *(terms[number].params for number in alike)])
    squares = np.zeros((len(terms), 0))

    def add(step: int, state: Mapping[str, Any]) -> None:
        nonlocal squares
        if step % stride or (step == 0 and model.observ_fluents):
            return
        found = np.zeros((len(terms), 1))
        with np.errstate(all="ignore"):  # without a term the rule may overflow
            many = {n: np.repeat(value, len(alike) + 1, axis=-1) for n, value in state.items()}
            each = raw(side_by_side, many, step)
            for place, number in enumerate(alike, 1):
                values = each[terms[number].action].astype(float)
                found[number] = np.mean(
                    (values[..., :1] - values[..., [place % values.shape[-1]]]) ** 2
                )
            for number in set(range(len(terms))) - set(alike):
                term = terms[number]
                without = raw(term.params, state, step)[term.action]
                whole = each[term.action][..., :1].astype(float)
                found[number] = np.mean((whole - without) ** 2)
        squares = np.append(squares, found, axis=1)

    _returns(formula, params, 1, add)
    means = squares.mean(axis=1) if squares.size else np.zeros(len(terms))
    units = np.array([raw_unit(formula.actions, term.action) for term in terms])
    sizes = units * np.sqrt(means)
    return [float(size) for size in np.where(np.isfinite(sizes), sizes, 0.0)]


def _stacked(trees: Sequence[Any]) -> Any:
    """Trees as one, the leaves that differ with a last axis for them."""
    first = trees[0]
    if isinstance(first, Mapping):
        return {name: _stacked([tree[name] for tree in trees]) for name in first}
    if all(leaf is first for leaf in trees):
        return first
    return np.stack(trees, axis=-1)


def _costs(
    formula: FeedbackFormula,
    params: Params,
    terms: Sequence[Term],
    until: float,
    clock: Callable[[], float],
) -> list[tuple[float, float] | tuple[None, None]]:
    """What the return loses without each term, and its standard error."""
    if clock() >= until:
        return [(None, None)] * len(terms)
    whole = _returns(formula, params, _ROLLOUTS)
    costs: list[tuple[float, float] | tuple[None, None]] = []
    for term in terms:
        if clock() >= until:
            costs.append((None, None))
            continue
        lost = whole - _returns(formula, term.params, _ROLLOUTS)
        cost = float(np.mean(lost)), float(np.std(lost) / np.sqrt(len(lost)))
        # without a term the model may diverge
        costs.append(cost if np.all(np.isfinite(cost)) else (None, None))
    return costs


def _equation(formula: FeedbackFormula, name: str, terms: tuple[ExplainedTerm, ...]) -> Equation:
    actions, rddl = formula.actions, formula.simulator.problem.model
    arguments = ", ".join(f"?{kind}" for kind in rddl.variable_params[name])
    left = f"{name}({arguments})" if arguments else name
    noop = np.asarray(actions.noop[name], float)
    if name not in actions.units:
        other = "false" if np.any(noop) else "true"
        return Equation(name, f"{left} is {other} if 0 <", "", terms)
    start = f"{noop.min():.4g}" if noop.min() == noop.max() else "its default"
    low, high = (np.asarray(bound, float) for bound in actions.bounds[name])
    is_bounded = bool(np.any(np.isfinite(low)) or np.any(np.isfinite(high)))
    within = f"clipped to [{_bound(low)}, {_bound(high)}]" if is_bounded else "without bounds"
    rounded = "" if rddl.variable_ranges[name] == "real" else ", rounded"
    return Equation(name, f"{left} = {start}", within + rounded, terms)


def _bound(values: np.ndarray) -> str:
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}, by object"


def _note(formula: FeedbackFormula) -> str:
    feedback = formula.actions.feedback
    relations = any(
        " from " in feature.name or " to " in feature.name
        for found in feedback.features.values()
        for feature in found.state
    )
    note = "a fluent of other objects than the action's stands for its mean over them"
    if relations:
        note += (
            "; 'f from R' is the mean of f over the objects y of R(x, y), 'f to R' of R(y, x); "
            "of two relations the last one is the first step"
        )
    if feedback.empty_memory():
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
