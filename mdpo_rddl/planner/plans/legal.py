"""Legal actions: the last layer of a policy, the same in rollouts and in play.

What a policy proposes may break a precondition or `max-nondef-actions`. Here it becomes a legal
action near it, as a pure function of the policy's probabilities and of the state:

1. integers are clipped to the whole numbers in their box;
2. bools that an implication forbids are false, and the limits on groups choose among the others;
3. numbers are projected onto the preconditions that are linear in them
   (`mdpo_rddl.planner.plans.linear_limits`);
4. if that is still illegal, the no-op takes its changes one by one, the most probable first, each
   only if the action stays legal; of a real's change it takes a legal share, found by bisection
   to 1/256, the largest one where every share below a legal one is legal; where the no-op itself
   is illegal, the most probable legal change of it comes first, and after the single ones a change
   of all bools of a fluent.

Where no legal action is found like that, the proposal stands.
"""

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from mdpo_rddl.planner.model.expressions import Value, compiled_expression
from mdpo_rddl.planner.plans.changes import Changes
from mdpo_rddl.planner.plans.limits import choose_within_limits
from mdpo_rddl.planner.plans.linear_limits import LinearLimits
from mdpo_rddl.problem.implications import Implication, Rules, fluents_of, read_rules
from mdpo_rddl.problem.legality import LARGEST_ROUNDING
from mdpo_rddl.problem.limits import GroupLimit, group_limits

Actions = dict[str, Array]


# what a search tries next
_PROPOSAL, _NOOP, _START, _ADDITION, _ENDED = range(5)
# the last step of a bisection, as a share of the way from the no-op to the proposal
_LEAST_STEP = 2.0**-8


class _Search(NamedTuple):
    """The search for a legal action.

    Attributes:
      mode: what is tried next.
      base: the best so far [D].
      starts: ranks of the changes of an illegal no-op that were not tried yet [K].
      additions: scores of the proposed changes that were not tried yet [D].
      share: of the change that is added next; below 1 while it is bisected.
      step: what a bisection takes off the share where it is illegal, or adds to it.
    """

    mode: Array
    base: Array
    starts: Array
    additions: Array
    share: Array
    step: Array


class LegalActions:
    """Makes proposals legal, as far as the exact model's compiled preconditions tell.

    Attributes:
      is_needed: whether a proposal can be illegal at all; whoever asks may skip the rest if not.
      has_boxes_only: whether nothing can be illegal but an integer that is outside of its box.
    """

    def __init__(self, compiled: Any, limits: Sequence[GroupLimit]) -> None:
        """Reads the preconditions.

        Args:
          compiled: the exact model as JaxPlan compiles it.
          limits: all limits on groups of bools that the policy keeps, `max-nondef-actions`
            among them if it is one.
        """
        rddl = compiled.rddl
        self._compiled, self._limits = compiled, list(limits)
        self._rules: Rules = read_rules(rddl)
        self._masks = [(rule, _compile_rule(compiled, rule)) for rule in self._rules.implications]
        self._fluents, self._nonfluents = compiled.split_fluent_nonfluent(compiled.init_values)
        self._linear = LinearLimits(compiled, self._rules.others)
        judged = {place: self._linear.judged(place) for place in self._rules.others}
        self._others = [compiled.preconditions[place] for place, one in judged.items() if not one]
        self._judged = [one for one in judged.values() if one]
        self._changes = Changes(compiled)
        self._integer_boxes = _integer_boxes(compiled)
        # the groups' limits are kept as they are, unless something is to be done everywhere
        unread = len(self._rules.others) - len(group_limits(rddl)[0])
        self._is_checked = unread > 0 or any(limit.exact for limit in self._limits)
        if rddl.max_allowed_actions < self._changes.size:
            self._is_checked |= self._changes.has_numbers or bool(np.any(self._changes.noop))
        self.has_boxes_only = not (self._masks or self._is_checked)
        self.is_needed = bool(self._integer_boxes) or not self.has_boxes_only

    def __call__(
        self, proposal: Mapping[str, Array], probabilities: Mapping[str, Array], state: Any
    ) -> Actions:
        """A legal action.

        Args:
          proposal: per action fluent [*shape].
          probabilities: per bool action fluent that of true [*shape], or what is in its order.
          state: the fluents that are known, each of its shape or, as the environment gives one
            without parameters, [1]; the others count with their initial values.
        """
        state = self._complete(state)
        actions = {name: jnp.asarray(value) for name, value in proposal.items()}
        for name, (lower, upper) in self._integer_boxes.items():
            actions[name] = jnp.clip(actions[name], lower, upper)
        allowed = self._allowed(state)
        if allowed:
            actions = self._masked(actions, probabilities, allowed)
        if self._linear.is_needed:
            actions = self._linear(actions, state)
        if not self._is_checked:
            return actions
        return self._repaired(actions, probabilities, state, allowed)

    def is_legal(self, actions: Mapping[str, Array], state: Any) -> Array:
        """Whether an action breaks no precondition and not `max-nondef-actions`.

        Args:
          actions: per action fluent [*shape]; reals in their box.
          state: as of a call.
        """
        state = self._complete(state)
        few = self._changes.count(self._changes.flat(actions))
        few = few <= self._compiled.rddl.max_allowed_actions
        return few & self._is_legal(dict(actions), state, self._allowed(state))

    def _complete(self, state: Any) -> Any:
        """The fluents that are known, each of its shape, and the initial values of others."""
        shapes = {name: np.shape(value) for name, value in self._fluents.items()}
        known = {name: jnp.reshape(value, shapes[name]) for name, value in state.items()}
        return {**self._fluents, **known}

    def _masked(
        self,
        actions: Actions,
        probabilities: Mapping[str, Array],
        allowed: Mapping[str, Array],
    ) -> Actions:
        actions = actions | {name: actions[name] & mask for name, mask in allowed.items()}
        grouped = {name for limit in self._limits for name in limit.groups}
        if not grouped & set(allowed):
            return actions
        left = {
            name: jnp.where(allowed[name], probabilities[name], 0.0)
            if name in allowed
            else probabilities[name]
            for name in grouped
        }
        return actions | choose_within_limits(left, self._limits)

    def _allowed(self, state: Any) -> Actions:
        allowed: Actions = {}
        for rule, holds in self._masks:
            mask = holds(state, self._nonfluents)
            allowed[rule.action] = allowed[rule.action] & mask if rule.action in allowed else mask
        return allowed

    def _is_legal(self, actions: Actions, state: Any, allowed: Mapping[str, Array]) -> Array:
        fluents, key = {**state, **actions}, jax.random.PRNGKey(0)
        params = self._compiled.model_aux["params"]
        legal = jnp.array(True)
        for holds in self._others:
            value, key, _, _ = holds(fluents, self._nonfluents, params, key)
            legal &= jnp.all(value)
        for holds in self._judged:
            legal &= holds(fluents)
        for name, mask in allowed.items():
            legal &= jnp.all(mask | ~actions[name])
        # what is tried may come from the box of another object
        for name, (lower, upper) in self._integer_boxes.items():
            legal &= jnp.all((lower <= actions[name]) & (actions[name] <= upper))
        return legal

    def _repaired(
        self,
        actions: Actions,
        probabilities: Mapping[str, Array],
        state: Any,
        allowed: Mapping[str, Array],
    ) -> Actions:
        """The actions, if they are illegal a legal action near them.

        One loop, so that the preconditions are compiled once; it ends with the first check
        where all rollouts of a batch are legal.
        """
        changes, most = self._changes, self._compiled.rddl.max_allowed_actions
        proposed = changes.flat(actions)
        scores = changes.scores(proposed, probabilities)
        candidates, ranks = changes.candidates(proposed, scores)
        idle = jnp.asarray(changes.noop)

        def try_next(search: _Search) -> _Search:
            start, addition = jnp.argmax(search.starts), jnp.argmax(search.additions)
            way = idle[addition] + search.share * (proposed[addition] - idle[addition])
            value = jnp.where(search.share < 1.0, way, proposed[addition])
            more = search.base.at[addition].set(value)
            options = jnp.stack([proposed, idle, candidates[start], more])
            tried = options[search.mode]
            few = changes.count(tried) <= most
            legal = few & self._is_legal(changes.tree(tried, actions), state, allowed)
            starts = jnp.where(search.mode == _START, search.starts.at[start].set(-jnp.inf), ranks)
            exhausted = (search.mode == _START) & ~jnp.any(starts > -jnp.inf)
            adding = search.mode == _ADDITION
            base = jnp.where(legal, tried, jnp.where(exhausted, proposed, search.base))
            bisected = adding & jnp.asarray(changes.is_real)[addition]
            bisected &= (~legal | (search.share < 1.0)) & (search.step >= _LEAST_STEP)
            left = search.additions.at[addition].set(
                jnp.where(bisected, scores[addition], -jnp.inf)
            )
            additions = jnp.where(adding, left, jnp.where(proposed != base, scores, -jnp.inf))
            full = ~jnp.any(additions > -jnp.inf) | (changes.count(base) >= most)
            full &= ~bisected
            ended = exhausted | ((legal | adding) & (full | (search.mode == _PROPOSAL)))
            mode = jnp.where(legal | adding, _ADDITION, jnp.minimum(search.mode + 1, _START))
            nearer = search.share + jnp.where(legal, search.step, -search.step)
            share = jnp.where(bisected, nearer, 1.0)
            step = jnp.where(bisected, search.step / 2.0, 0.5)
            return _Search(jnp.where(ended, _ENDED, mode), base, starts, additions, share, step)

        nowhere = jnp.full(changes.size, -jnp.inf, jnp.float32)
        whole, half = jnp.float32(1.0), jnp.float32(0.5)
        first = _Search(jnp.array(_PROPOSAL), proposed, ranks, nowhere, whole, half)
        found = lax.while_loop(lambda search: search.mode != _ENDED, try_next, first)
        return changes.tree(found.base, actions)


def legal_policy(plan: Any, compiled: Any, limits: Sequence[GroupLimit]) -> Callable[..., Actions]:
    """A compiled plan's test policy, made legal.

    Args:
      plan: the compiled plan.
      compiled: the exact model as JaxPlan compiles it.
      limits: on groups of bools, which the plan's policy keeps.
    """
    policy = plan.test_policy
    # a plan's own limit on all bools must hold together with the groups'
    legal = LegalActions(compiled, [*limits, *getattr(plan, "concurrency", [])])
    if not legal.is_needed:
        return policy
    probabilities_of = getattr(plan, "preferences", None) or plan.train_policy

    def legalised(key, params, hyperparams, step, state, history):
        arguments = key, params, hyperparams, step, state, history
        return legal(policy(*arguments), probabilities_of(*arguments), state)

    return legalised


def compile_playable(compiled: Any) -> Value | None:
    """Compiles whether the preconditions allow an action, up to rounding.

    Args:
      compiled: the exact model as JaxPlan compiles it.

    Returns:
      A function of the fluents with the actions' values and of the non-fluents; None where
      `LegalActions` finds a legal action in every state, or finds none for reasons that no state
      has.
    """
    rddl = compiled.rddl
    if not may_leave_none(rddl):
        return None
    rounded = copy.copy(compiled)
    rounded.__class__ = type("Rounded", (_Rounded, type(compiled)), {})
    conditions = [compiled_expression(rounded, each, jnp.bool_) for each in rddl.preconditions]

    def playable(fluents: Mapping[str, Any], nonfluents: Mapping[str, Any]) -> Array:
        return jnp.all(jnp.stack([jnp.all(each(fluents, nonfluents)) for each in conditions]))

    return playable


def may_leave_none(rddl: Any) -> bool:
    """Whether some state may leave no legal action, as far as the form of the preconditions tells.

    Those on single bools and those that limit how many are true always leave one: the no-op, or it
    with fewer of its bools. So do those that read no state, if they do in the first.
    """
    rules, limits = read_rules(rddl), group_limits(rddl)[0]
    actions, others = set(rddl.action_fluents), len(rules.others)
    read = [fluents_of(each) for each in rddl.preconditions]
    on_states = [names for names in read if names - actions - set(rddl.non_fluents)]
    demands = others > sum(not limit.exact for limit in limits)
    return bool(on_states) and (demands or any(not names & actions for names in on_states))


class _Rounded:
    """A compiler of JaxPlan's whose numbers may be equal up to rounding where that is allowed."""

    def _jax_greater_equal(self, expr: Any, aux: Any) -> Any:
        return self._up_to_rounding(expr, aux, lambda left, right, by: left >= right - by)

    def _jax_less_equal(self, expr: Any, aux: Any) -> Any:
        return self._up_to_rounding(expr, aux, lambda left, right, by: left <= right + by)

    def _jax_equal(self, expr: Any, aux: Any) -> Any:
        return self._up_to_rounding(expr, aux, lambda left, right, by: abs(left - right) <= by)

    def _up_to_rounding(self, expr: Any, aux: Any, compare: Callable[..., Array]) -> Any:
        def compared(left: Array, right: Array) -> Array:
            is_real = jnp.issubdtype(jnp.result_type(left, right), jnp.floating)
            by = LARGEST_ROUNDING * (1.0 + abs(left) + abs(right)) if is_real else 0
            return compare(left, right, by)

        helper = cast(Any, self)._jax_binary_helper
        return helper(expr, aux, compared, at_least_int=True)


def _compile_rule(compiled: Any, rule: Implication) -> Callable[[Any, Any], Array]:
    """A function of fluents and non-fluents: which components may be true [*action shape]."""
    parts = (*rule.given, rule.condition)
    values = [compiled_expression(compiled, part, jnp.bool_) for part in parts]
    unused = set(range(len(rule.sizes))) - set(rule.axes)
    kept = sorted(rule.axes)
    order = [kept.index(axis) for axis in rule.axes]

    def holds(fluents: Any, nonfluents: Any) -> Array:
        *given, condition = (value(fluents, nonfluents) for value in values)
        for value in given:
            condition = condition | ~value
        whole = jnp.broadcast_to(condition, rule.sizes)
        return jnp.transpose(jnp.all(whole, axis=tuple(unused)), order)

    return holds


def _integer_boxes(compiled: Any) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """The smallest and largest whole number in the box of each bounded integer action."""
    largest = float(np.iinfo(np.int32).max - 128)
    boxes: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for name in compiled.rddl.action_fluents:
        if compiled.rddl.variable_ranges[name] != "int":
            continue
        lower, upper = (np.asarray(b, float) for b in compiled.constraints.bounds[name])
        lower, upper = np.ceil(lower), np.floor(upper)
        if np.any(np.abs(lower) < largest) or np.any(np.abs(upper) < largest):
            ends = (np.clip(end, -largest, largest).astype(np.int32) for end in (lower, upper))
            boxes[name] = tuple(ends)
    return boxes
