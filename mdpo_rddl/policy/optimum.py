"""The optimum of a problem whose reachable states can be enumerated, and how to play it.

Backward induction over the horizon H, with V_H = 0 and discount g:

    V_t(s) = max_a  r(s, a) + g sum_s' P(s' | s, a) V_{t+1}(s')

The sum is worked out once for all states and actions after which the next state is drawn in
the same way.

A state d in which the episode goes on and no action is legal is a dead end. Where it can be avoided
for certain, only actions that do so are looked at. Elsewhere it has a value of its own: with the
least and the largest reward of a legal step, r_min and r_max, and A_t = sum_{k < t} g^k,

    g^t V_t(d) = r_min (A_H - A_t) - (r_max - r_min) (A_H + A_t)

Whatever was collected before, an episode with a dead end is then worth less than the worst legal
one, by the whole range of returns. After the last step nothing has to be done any more, and no
state is a dead end.
"""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mdpo_rddl.policy.table import ActionTable, Optimum
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.enumeration.factored import enumerate_factored
from mdpo_rddl.problem.enumeration.irrelevance import Merge
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import GroundModel, ground_model
from mdpo_rddl.problem.enumeration.packing import keys
from mdpo_rddl.problem.enumeration.states import Enumeration, enumerate_states
from mdpo_rddl.problem.load import Problem, make_environment

logger = logging.getLogger(__name__)

_BYTES_PER_TRANSITION = 60
_TIE = 1e-12
# a risk below is rounding
_NO_RISK = 1e-12
# of the time: where the rules alone take longer, so do the states
_GROUNDING_SHARE = 0.4
# of the states at each step: more are not kept
_MOST_VALUES = 2**24

Run = tuple[int, np.ndarray, np.ndarray]
"""A step, states, and the action played in each up to that step."""


@dataclass(frozen=True)
class Solution:
    """A problem's optimum.

    Attributes:
      problem: that it is of.
      optimum: the best expected return, proven up to rounding, and what it took.
      table: actions that attain it.
    """

    problem: Problem
    optimum: Optimum
    table: ActionTable

    @property
    def value(self) -> float:
        """Expected return of the best policy from the initial state."""
        return self.optimum.value

    def policy(self, seed: int = 0) -> TablePolicy:
        """Plays the table.

        Args:
          seed: of the run, to be kept with it; nothing is drawn.
        """
        return TablePolicy(self.problem, self.table, self.optimum, seed)


def find_optimum(
    problem: Problem,
    seconds: float,
    memory_gb: float = 4.0,
    clock: Callable[[], float] = time.monotonic,
    keeps_values: bool = False,
) -> Solution:
    """The optimum.

    Args:
      problem: with discrete, observed states.
      seconds: limit of the time by the clock.
      memory_gb: limit of the memory that the enumeration takes, roughly.
      clock: what is asked for the time.
      keeps_values: whether the table has the states' values, unless they are too many.

    Raises:
      NotEnumerableError: says why there is none.
    """
    started = clock()
    most = int(memory_gb * 2**30 / _BYTES_PER_TRANSITION)
    limits = EnumerationLimits(seconds=seconds, transitions=min(30_000_000, most), clock=clock)
    grounding = EnumerationLimits(seconds=_GROUNDING_SHARE * seconds, clock=clock)
    model = ground_model(problem, grounding)
    try:
        enumeration = enumerate_factored(model, limits)
    except NotEnumerableError as error:
        logger.debug("not factored: %s", error)
        enumeration = enumerate_states(model, limits)
    merges, states = enumeration.merges, enumeration.states
    keeps_values &= len(states) * model.horizon <= _MOST_VALUES
    kept = np.zeros((model.horizon, len(states)), np.float32) if keeps_values else None
    value, risk, runs = _induct(enumeration, limits, kept)
    if risk > 0.0:
        logger.warning(
            "a state in which no action is legal cannot be avoided: the best policy comes to one "
            "with probability %.3g, which the optimum counts as less than any legal play",
            risk,
        )
    if kept is not None and not np.isfinite(kept).all():
        kept = None  # too large for 32 bits
    table = action_table(problem, model, merges, states, runs, kept)
    optimum = Optimum(
        value=value,
        states=len(enumeration.states),
        transitions=enumeration.transitions.nnz,
        actions=len(enumeration.model.actions),
        seconds=clock() - started,
    )
    return Solution(problem, optimum, table)


def _induct(
    enumeration: Enumeration, limits: EnumerationLimits, kept: np.ndarray | None
) -> tuple[float, float, list[Run]]:
    """The initial state's value and risk, and where the best action changes, the last step first.

    The risk is the probability of coming to a dead end. The values of all states at each step are
    written to `kept` [H, S], if it is given.
    """
    model, first = enumeration.model, enumeration.first_row
    decided = np.flatnonzero(np.diff(first))
    starts, counts = first[decided], np.diff(first)[decided]
    values = np.zeros(len(enumeration.states))
    if enumeration.dead[0]:
        raise NotEnumerableError("an initial state without a legal action")
    if not len(decided):
        return 0.0, 0.0, []
    risk = np.zeros(len(enumeration.states)) if enumeration.dead.any() else None
    best_row, runs, q = np.full(len(decided), -1), [], np.empty(len(enumeration.reward))
    for step in reversed(range(model.horizon)):
        limits.check_time()
        after = model.discount * (enumeration.transitions @ values)
        # none is out of range; for "raise" numpy would make another array
        np.take(after, enumeration.afterstate, out=q, mode="clip")
        q += enumeration.reward
        if risk is not None:
            risks = np.take(enumeration.transitions @ risk, enumeration.afterstate, mode="clip")
            is_safe = risks <= _NO_RISK
            can_be_safe = np.repeat(np.logical_or.reduceat(is_safe, starts), counts)
            q[can_be_safe & ~is_safe] = -np.inf
        best = np.maximum.reduceat(q, starts)
        # rounding shall not change the action from step to step
        enough = best - _TIE * (1 + np.abs(best))
        lost = np.flatnonzero((best_row < 0) | ~(q[best_row] >= enough))
        chosen = best_row.copy()
        chosen[lost] = _first_rows(q, enough[lost], starts[lost], counts[lost])
        values[decided] = best
        if risk is not None:
            values[enumeration.dead] = _dead_end_value(enumeration, step)
            risk[decided] = np.where(risks[chosen] <= _NO_RISK, 0.0, risks[chosen])
            risk[enumeration.dead] = 1.0
        if kept is not None:
            kept[step] = values
        changed = enumeration.action[chosen] != enumeration.action[best_row]
        changed = (changed | (best_row < 0)) & (enumeration.depth[decided] <= step)
        runs.append((step, decided[changed], enumeration.action[chosen[changed]]))
        best_row = chosen
    return float(values[0]), 0.0 if risk is None else float(risk[0]), runs


def _dead_end_value(enumeration: Enumeration, step: int) -> float:
    """What a state is worth at a step at which an action is due and none is legal."""
    model = enumeration.model
    least, most = float(enumeration.reward.min()), float(enumeration.reward.max())
    # where all steps pay the same, one more of them is lost
    width = most - least or abs(least) or 1.0
    powers = model.discount ** np.arange(model.horizon)
    before, whole = powers[:step].sum(), powers.sum()
    value = least * (whole - before) - width * (whole + before)
    # what later steps pay is rounding
    return float(value / max(model.discount**step, _NO_RISK))


def _first_rows(
    q: np.ndarray, enough: np.ndarray, starts: np.ndarray, counts: np.ndarray
) -> np.ndarray:
    """The first row of each of some states [N] whose value is enough.

    Args:
      q: values of all rows.
      enough: what each state asks for [N].
      starts: the first row of each state [N].
      counts: how many rows it has, at least one [N].
    """
    if not len(starts):
        return starts
    ends = np.cumsum(counts)
    first = ends - counts
    rows = np.arange(ends[-1]) + np.repeat(starts - first, counts)
    found = np.where(q[rows] >= np.repeat(enough, counts), rows, len(q))
    return np.minimum.reduceat(found, first)


def action_table(
    problem: Problem,
    model: GroundModel,
    merges: Sequence[Merge],
    states: np.ndarray,
    runs: Sequence[Run],
    values: np.ndarray | None = None,
) -> ActionTable:
    """The table.

    Args:
      problem: that it is of.
      model: of the problem.
      merges: how states were joined.
      states: packed [S, words]; runs name them by their numbers.
      runs: where actions change; a state without one is left out.
      values: of the states at each step [H, S], if they are kept.
    """
    steps = np.repeat([step for step, _, _ in runs], [len(some) for _, some, _ in runs])
    played_in, action = np.zeros((2, 0), np.int64)
    if runs:
        played_in = np.concatenate([some for _, some, _ in runs])
        action = np.concatenate([played for _, _, played in runs])
    used = np.unique(played_in)
    order = used[np.argsort(keys(states[used]))]
    rank = np.zeros(len(states), np.int64)
    rank[order] = np.arange(len(order))
    sequence = np.lexsort((steps, rank[played_in]))
    counts = np.bincount(rank[played_in], minlength=len(order))
    decided = int(steps.max(initial=-1)) + 1
    names = [name for name, _ in model.variables]
    return ActionTable(
        merges=np.array(merges, np.uint64).reshape(len(merges), 3, states.shape[1]),
        places=np.array(model.packing.places, np.int64).reshape(-1, 4),
        states=states[order],
        first_run=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        until_step=steps[sequence].astype(np.int32),
        action=action[sequence].astype(np.int32),
        actions=_action_values(problem, model),
        fluents=tuple(dict.fromkeys(names)),
        objects=_object_names(problem, names),
        values=None if values is None else np.ascontiguousarray(values[:decided, order]),
    )


def _action_values(problem: Problem, model: GroundModel) -> dict[str, np.ndarray]:
    """Per action fluent its values in every joint action [A, *shape]."""
    noop = make_environment(problem).sampler.noop_actions
    found = {}
    for name, default in noop.items():
        default = np.asarray(default)
        values = np.repeat(default[np.newaxis], len(model.actions), axis=0)
        for number, rules in enumerate(model.actions):
            for (fluent, place), value in rules.assignment.items():
                if fluent == name:
                    values[(number, *place)] = value
        found[name] = values
    return found


def _object_names(problem: Problem, names: list[str]) -> dict[str, tuple[str, ...]]:
    rddl = problem.model
    return {
        name: tuple(rddl.type_to_objects[rddl.variable_ranges[name]])
        for name in dict.fromkeys(names)
        if rddl.variable_ranges[name] in rddl.type_to_objects
    }
