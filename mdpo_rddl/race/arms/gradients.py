"""MDPO: the gradient of the relaxed model's return, with noise on the actions.

Its program is compiled, and trains, in a process of its own: what compiles is not imported here,
and threads that trace or compile would take the interpreter from whoever works (a loop of rollouts
ran at 0.2 to 0.4 of its speed beside such a thread, at 0.5 to 0.6 beside such a process on the same
core, at 0.7 to 0.9 with a second one). Where there is more than one core the training goes on while
other arms work.

Two scopes, one for each problem: all parameters of the best feedback policy; and, where chance
plays no part and all actions are real, a straight-line plan alone, from what the leader plays: no
policy returns more than the best plan then.
"""

import logging
import pickle
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.machine.child import Child, ChildEndedError
from mdpo_rddl.machine.cores import usable_cores
from mdpo_rddl.machine.messages import Messages, packed, unpacked
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.race.arm import Arm, Candidate, Context, Turn
from mdpo_rddl.race.weights import Params
from mdpo_rddl.simulator.rollouts import rollout

logger = logging.getLogger(__name__)

FEEDBACK, PLAN = "gradient", "plan by gradient"

# of a race, that what compiles can pay for itself
_LEAST_SECONDS = 20.0
# of the time left: when a program that is not compiled yet is given up
_GIVEN_UP = 0.5
# factors of the configuration's step size and noise, one for each restart
_STEPS, _NOISE = (0.3, 1.0, 1.0, 3.0), (0.3, 0.3, 1.0, 1.0)
# of a plan: Adam's step size in units, which are not normalised; half of the restarts have hardly
# any noise and climb, the others leave local optima
_RATE, _PLAN_STEPS = 0.004, (0.25, 0.5, 1.0, 2.0) * 2
_PLAN_NOISE = (0.003,) * 4 + (0.3,) * 4
# of the time used: a slice while others work
_SHARE = 0.05
# between two looks at what is pending
_PAUSE = 0.05


class GradientState(NamedTuple):
    """See `mdpo_rddl.race.arm.State`.

    Attributes:
      child: the process that compiles and trains.
      parent: whose policy the phase began with.
      best: what the phase's best policy returns by the child's account.
      has_gained: whether the latest slice has found something better by that.
    """

    child: Child
    found: tuple[Candidate, ...] = ()
    claim: float = -np.inf
    iterations: int = 0
    is_ready: bool = False
    is_exhausted: bool = False
    details: Mapping[str, Any] = {}
    parent: Candidate | None = None
    best: float = -np.inf
    has_gained: bool = False


def feedback_gradient() -> Arm:
    """All parameters of the best feedback policy."""

    def init(context: Context) -> GradientState | None:
        if _is_plan_enough(context):
            return None
        start = context.family.noop
        return _begun(context, context.family.config, start, (_STEPS, _NOISE))

    return _arm(FEEDBACK, init, best_feedback)


def plan_gradient() -> Arm:
    """A straight-line plan, from what the leader plays."""

    def init(context: Context) -> GradientState | None:
        if not _is_plan_enough(context) or "plan" not in context.family.noop:
            return None
        config = context.family.config.with_values(
            "Planner",
            optimizer="adam",
            optimizer_kwargs={"learning_rate": _RATE, "b2": 0.95, "eps": 1e-12},
            batch_size_train=1,
            batch_size_test=1,
            parallel_updates=len(_PLAN_STEPS),
        )
        start = _plan_alone(context, context.family.noop["plan"])
        return _begun(context, config, start, (_PLAN_STEPS, _PLAN_NOISE))

    return _arm(PLAN, init, played_plan)


def best_feedback(context: Context, turn: Turn) -> tuple[Params, Candidate]:
    """The parameters of the best feedback policy, and whose they are."""
    assert turn.best_feedback is not None  # the no-op is one
    candidate = turn.best_feedback.candidate
    return candidate.policy.params, candidate


def played_plan(context: Context, turn: Turn) -> tuple[Params, Candidate]:
    """What the leader plays as the parameters of a straight-line plan, and whose that is."""
    play = turn.leader.candidate.policy.replicated()
    assert play is not None  # else it could not lead
    kept = rollout(context.simulator, play, 1, context.seed, keep=True).trajectories
    assert kept is not None
    played = {n: np.moveaxis(each[..., 0], 0, -1) for n, each in kept.actions.items()}
    plan = {}
    for name, raw in context.family.raw(played).items():
        raw = np.moveaxis(raw, -1, 0)
        whole = context.family.noop["plan"][name]
        # after an episode's early end nothing is played
        plan[name] = np.concatenate([raw, whole[len(raw) :]]).astype(whole.dtype)
    return _plan_alone(context, plan), turn.leader.candidate


def serve(messages: Messages) -> None:
    """The process."""
    from mdpo_rddl.planner.training.beside import train_beside

    train_beside(messages)


def _arm(
    name: str,
    init: Callable[[Context], GradientState | None],
    start: Callable[[Context, Turn], tuple[Params, Candidate]],
) -> Arm:
    """The arm of a scope; `start` says with what a phase begins, and whose that is."""

    def step(context: Context, state: GradientState, turn: Turn) -> GradientState:
        state = state._replace(found=())
        goes_on_beside = usable_cores() > 1
        if not state.is_ready:
            state = _heard(context, name, state, 0.0)
            if not (goes_on_beside and state.is_ready):
                return state
        used, left = context.budget.used, context.budget.left
        seconds = min(_SHARE * used, left)
        if not goes_on_beside:
            seconds = turn.until - context.budget.clock()
        state = _asked(state, turn, partial(start, context), seconds)
        # on one core nobody else gets on better meanwhile
        while not goes_on_beside and not state.is_ready and not state.is_exhausted:
            if context.budget.clock() >= turn.until:
                break
            context.on_iteration()
            state = _heard(context, name, state, _PAUSE)
        return state

    return Arm(name, init, step, lambda state: state.child.end(), improves=True)


def _begun(
    context: Context,
    config: PlannerConfig,
    start: Params,
    factors: tuple[Sequence[float], Sequence[float]],
) -> GradientState | None:
    """Has a process compile what trains such parameters; None where that is of no use."""
    ranges, budget = context.problem.model.variable_ranges, context.budget
    is_real = "real" in {ranges[name] for name in context.problem.model.action_fluents}
    if not is_real or budget.seconds < _LEAST_SECONDS:
        return None
    seed = int(context.generator(FEEDBACK).integers(2**31))
    task = context.problem, config, start, *factors, seed, _GIVEN_UP * budget.left
    try:
        message = packed(task)
        child = Child(serve)
    except (pickle.PicklingError, AttributeError, TypeError, OSError) as error:
        # functions in Python that are from no file
        logger.info("no gradient: %s", one_line_cause(error))
        return None
    child.ask(message)
    return GradientState(child)


def _heard(context: Context, name: str, state: GradientState, seconds: float) -> GradientState:
    """The state with what the child says within so many seconds, if it says something."""
    try:
        reply = state.child.answer(seconds)
    except TimeoutError:
        return state
    except ChildEndedError as error:
        reply = {"error": str(error)}
    if "error" in reply:
        logger.info("%s is of no use: %s", name, reply["error"])
        details = {**state.details, "cause": reply["error"]}
        return state._replace(is_exhausted=True, details=details)
    state = state._replace(is_ready=True)
    if "compile_seconds" in reply:
        return state._replace(details={**state.details, **reply})
    has_gained = reply["returned"] > state.best
    details = {**state.details, "phases": reply["phases"], "not_finite": reply["not_finite"]}
    state = state._replace(
        iterations=reply["iterations"],
        best=max(state.best, reply["returned"]),
        has_gained=has_gained,
        details=details,
    )
    if not has_gained:
        return state
    policy = context.family.policy(unpacked(reply["params"]))
    returns = context.evaluator.more(policy.replicated(), np.zeros(0), context.on_iteration)
    parent = state.parent
    parents = () if parent is None else tuple(dict.fromkeys((*parent.parents, parent.arm)))
    label = f"{name}, iteration {state.iterations:,}"
    candidate = Candidate(name, label, policy, parents, uses_noise=True, returns=returns)
    claim = max(state.claim, float(np.mean(returns)))
    return state._replace(found=(candidate,), claim=claim)


def _asked(
    state: GradientState,
    turn: Turn,
    start: Callable[[Turn], tuple[Params, Candidate]],
    seconds: float,
) -> GradientState:
    """The state while the child trains for so many seconds.

    A phase goes on as long as each slice gains; else the next begins.
    """
    params = None
    if not state.has_gained:
        params, parent = start(turn)
        state = state._replace(parent=parent, best=-np.inf)
    try:
        state.child.ask({"start": None if params is None else packed(params), "seconds": seconds})
    except ChildEndedError as error:
        return state._replace(is_exhausted=True, details={**state.details, "cause": str(error)})
    return state._replace(is_ready=False)


def _is_plan_enough(context: Context) -> bool:
    """Whether a plan returns as much as any policy, and all of it follows a gradient."""
    ranges = context.problem.model.variable_ranges
    kinds = {ranges[name] for name in context.problem.model.action_fluents}
    return context.certain and kinds == {"real"}


def _plan_alone(context: Context, plan: Params) -> Params:
    own = {name: {"bias": entry["bias"]} for name, entry in context.family.noop["own"].items()}
    return {"own": own, "plan": plan}
