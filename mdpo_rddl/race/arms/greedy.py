"""A value that is learnt from exact rollouts, and the greedy policy of it.

Each iteration plays the greedy policy of the value (`mdpo_rddl.policy.greedy`), takes the
lambda-returns of its rollouts as what the value should be, and fits the value to those of the
latest iterations: the optimistic policy iteration of Bertsekas and Tsitsiklis (1996),
"Neuro-Dynamic Programming". In the first one half of the rollouts are those of the best policy so
far, and the others play at random.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.planner.config.fitting import greedy as greedy_config
from mdpo_rddl.policy.greedy import Changes, GreedyFormula, Params
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.problem.evaluation import mean_and_error
from mdpo_rddl.race.arm import Arm, Candidate, Context, Turn

GREEDY = "greedy"

# rollouts of an iteration, at first and at most, half of them the greedy policy's; they are doubled
# while an iteration takes less than this share of the seconds so far. At first they are so few that
# a step tries no more actions than these in all
_FEWEST, _MOST, _SHARE, _ACTIONS = 64, 128, 0.03, 4096
# of the steps of the other half at which a change is decided at random; with which one goes on at
# the next step, as what leads somewhere takes several; and leaves the no-op rather than staying
_TRIED, _LASTS, _LEAVES = 0.1, 0.75, 0.75
# lambda
_TRACE = 0.7
# iterations whose rollouts are learnt from
_KEPT = 4
# updates of an iteration, times as many in the first, and states of each
_UPDATES, _FIRST, _MINIBATCH = 100, 4, 512
# Adam's step size at the beginning, and as a share of it at the end; its decays
_STEP, _LAST, _DECAYS = 3e-3, 0.05, (0.9, 0.999)
# of the scale of the targets: what an iteration changes
_NEWS = 0.2
# standard errors below the leader at which a policy is still worth the evaluator's episodes
_ERRORS = 2.0
_TINY = 1e-6
_LEVELS = "levels"


class _Rollouts(NamedTuple):
    """N rollouts of H steps.

    Attributes:
      inputs: what the value reads before each step [H, size, N].
      rewards: of each step, zero after the end [H, N].
      alive: up to the step that ends the episode [H, N].
      tried: whether a change was decided at random [H, N].
      returns: discounted [N].
    """

    inputs: np.ndarray
    rewards: np.ndarray
    alive: np.ndarray
    tried: np.ndarray
    returns: np.ndarray


class _Data(NamedTuple):
    """What the value is fitted to, of one iteration: M states.

    Attributes:
      inputs: [size, M].
      steps: [M].
      targets: less their mean at the step [M].
    """

    inputs: np.ndarray
    steps: np.ndarray
    targets: np.ndarray


class GreedyState(NamedTuple):
    """See `mdpo_rddl.race.arm.State`.

    Attributes:
      formula: of the policies.
      params: of the value, in units of `scale`, but the levels.
      scale: of the targets; 0 before the first iteration.
      moments: Adam's, and the number of its updates.
      kept: of the latest iterations.
      rollouts: of the next iteration.
      parents: arms that the first iteration's guide goes back to.
    """

    formula: GreedyFormula
    params: Params
    moments: tuple[Params, Params, int]
    rollouts: int
    scale: float = 0.0
    kept: tuple[_Data, ...] = ()
    parents: tuple[str, ...] = ()
    found: tuple[Candidate, ...] = ()
    claim: float = -np.inf
    iterations: int = 0
    is_ready: bool = True
    is_exhausted: bool = False
    details: Mapping[str, Any] = {}


def greedy_arm() -> Arm:
    """The arm; where all actions have few values and the state is observed."""
    return Arm(GREEDY, _init, _step)


def _init(context: Context) -> GreedyState | None:
    model = context.problem.model
    if model.observ_fluents or Changes.of(context.simulator) is None:
        return None
    config = greedy_config(context.family.config)
    formula = GreedyFormula(context.problem, config, context.simulator)
    params = formula.values.initial(context.generator(GREEDY))
    none = {name: np.zeros_like(value) for name, value in params.items() if name != _LEVELS}
    rollouts = _FEWEST
    while rollouts > 2 and rollouts * formula.samples * formula.changes.size > _ACTIONS:
        rollouts //= 2
    return GreedyState(formula, params, (none, none, 0), rollouts)


def _step(context: Context, state: GreedyState, turn: Turn) -> GreedyState:
    """Learns, and offers the policy of the slice whose rollouts have returned most."""
    best: tuple[float, float, Params] | None = None
    while True:
        context.on_iteration()
        began, played = context.budget.used, _in_units(state)
        state, returns = _iterated(context, state, turn)
        mean, error = mean_and_error(returns) if len(returns) else (-np.inf, 0.0)
        if state.iterations > 1 and np.isfinite(mean) and (best is None or mean > best[0]):
            best = mean, error, played
        takes = context.budget.used - began
        if takes < _SHARE * context.budget.used and state.rollouts < _MOST:
            state = state._replace(rollouts=2 * state.rollouts)
        if context.budget.clock() + takes > turn.until and (best or takes > turn.until):
            break
        if context.budget.left <= 0.0:
            break
    if best is None:
        return state._replace(found=())
    mean, error, params = best
    if not mean + _ERRORS * error > turn.leader.mean:
        return state._replace(found=(), claim=mean)
    policy = _policy(context, state, params)
    label = f"{GREEDY}, iteration {state.iterations:,}"
    candidate = Candidate(GREEDY, label, policy, state.parents)
    return state._replace(found=(candidate,), claim=mean)


def _policy(context: Context, state: GreedyState, params: Params) -> Policy:
    config = greedy_config(context.family.config)
    compiled = Compiled(greedy=state.formula)
    return Policy(context.problem, config, params, {}, context.seed, compiled=compiled)


def _in_units(state: GreedyState) -> Params:
    """The value's parameters in the units of the rewards."""
    heads = ("direct", "direct_left", "output", "output_left")
    scale = np.float32(state.scale)
    return {n: v * scale if n in heads else v for n, v in state.params.items()}


def _iterated(context: Context, state: GreedyState, turn: Turn) -> tuple[GreedyState, np.ndarray]:
    """The state after an iteration, and the returns of the policy before it, if it was finite."""
    random = context.generator(GREEDY, state.iterations)
    is_first = not state.kept
    if is_first:
        leader = turn.leader.candidate
        parents = tuple(dict.fromkeys((*leader.parents, leader.arm)))
        state = state._replace(parents=parents)
    guide = leader.policy.replicated() if is_first else None
    played = _played(context, state, guide, random)
    own = played.returns[: len(played.returns) // 2]
    discount = float(context.problem.model.discount)
    count = played.alive.sum(axis=1)
    values = _each(state, played.inputs)
    values = values * state.scale + state.params[_LEVELS][:, np.newaxis]
    # at first there is no policy yet whose value other actions could disturb
    off_policy = played.tried & (not is_first)
    trace = 1.0 if is_first else _TRACE
    returns = _lambda_returns(played, values, off_policy, (discount, trace))
    counts = played.alive & ~off_policy
    levels = (returns * counts).sum(axis=1) / (counts.sum(axis=1) + _TINY)
    targets = returns - levels[:, np.newaxis]
    spread = float(np.sqrt((counts * targets**2).sum() / (counts.sum() + _TINY))) + _TINY
    if not np.isfinite(spread) or not count.any():
        return state._replace(iterations=state.iterations + 1), np.zeros(0)
    scale = spread if is_first else (1.0 - _NEWS) * state.scale + _NEWS * spread
    steps, replicas = np.nonzero(counts)
    data = _Data(played.inputs[steps, :, replicas].T, steps, targets[steps, replicas])
    state = state._replace(
        params={**state.params, _LEVELS: levels.astype(np.float32)},
        scale=scale,
        kept=(*state.kept, data)[-_KEPT:],
        iterations=state.iterations + 1,
    )
    updates = _UPDATES * (_FIRST if is_first else 1)
    pace = _STEP * max(_LAST, 1.0 - context.budget.used / context.budget.seconds)
    return _fitted(context, state, random, (updates, pace)), own


def _played(
    context: Context, state: GreedyState, guide: Any, random: np.random.Generator
) -> _Rollouts:
    """Rollouts under the exact model, the second half with changes decided at random."""
    simulator, formula = context.simulator, state.formula
    horizon, count = context.problem.horizon, state.rollouts
    params, size = _in_units(state), formula.changes.size
    current = simulator.initial(count)
    half = np.arange(count) < count // 2
    alive = ~simulator.ended(current)
    share = np.where(half, 0.0, _TRIED if guide is None else 1.0)
    place, leaves = np.zeros(count, int), np.zeros(count, bool)
    rows: list[tuple[np.ndarray, ...]] = []
    returns, factor, largest = np.zeros(count), 1.0, 0.0
    for step in range(horizon):
        if not alive.any():
            break
        if step % 8 == 7:
            context.on_iteration()
        new = (random.random(count) >= _LASTS) | (step == 0)
        place = np.where(new, random.integers(0, size + 1, count), place)
        leaves = np.where(new, random.random(count) < _LEAVES, leaves)
        tried = random.random(count) < share
        seed = [context.seed, state.iterations, step]
        with np.errstate(all="ignore"):
            if guide is None:
                gains = formula.gains(params, current, step, seed)
            else:
                gains = np.full((size, count), -1.0)
            forced = _forced(gains, place, leaves)
            actions = formula.choose(np.where(tried, forced, gains), current)
        if guide is not None:
            own = guide(step, simulator.observation(current))
            actions = {n: np.where(half, own[n], a).astype(a.dtype) for n, a in actions.items()}
            guide.were_played(actions)
        inputs = formula.values.inputs({n: current[n] for n in context.problem.model.state_fluents})
        dead = ~simulator.legal(current, actions)
        after = simulator.step(current, actions, random)
        lost = alive & (dead | after.errors)
        reward = np.where(alive & ~after.errors, after.rewards, 0.0)
        largest = max(largest, float(np.max(np.abs(reward), initial=0.0)))
        # what cannot be played costs all that an episode can return, and more
        reward = np.where(lost, -2.0 * horizon * (largest or 1.0), reward)
        rows.append((inputs, reward, alive, tried & alive))
        returns += factor * reward
        factor *= float(context.problem.model.discount)
        alive = alive & ~lost & ~after.terminated & ~after.broken
        current = after.state
    inputs, rewards, living, tries = (np.stack(each) for each in zip(*rows, strict=True))
    missing = horizon - len(rows)
    rewards, living, tries = (
        np.pad(each, ((0, missing), (0, 0))) for each in (rewards, living, tries)
    )
    whole = np.pad(inputs, ((0, missing), (0, 0), (0, 0)))
    return _Rollouts(whole, rewards, living, tries, returns)


def _forced(gains: np.ndarray, place: np.ndarray, leaves: np.ndarray) -> np.ndarray:
    """Gains [D, N] of which one says that its change is made or not, whatever it gains.

    Args:
      gains: of all changes.
      place: the number of that one, from 1; 0 for the no-op, of which no change is made [N].
      leaves: whether it is made [N].
    """
    finite = np.where(np.isfinite(gains), gains, 0.0)
    most = 2.0 * np.max(np.abs(finite), axis=0) + _TINY
    forced, everyone = gains.copy(), np.arange(gains.shape[1])
    forced[np.maximum(place - 1, 0), everyone] = np.where(leaves, most, -most)
    return np.where(place == 0, -most, forced)


def _lambda_returns(
    played: _Rollouts, values: np.ndarray, off_policy: np.ndarray, decay: tuple[float, float]
) -> np.ndarray:
    """The lambda-return of each step [H, N], cut where another action was tried.

    G_t = r_t + gamma ((1 - lambda) v_{t+1} + lambda G_{t+1}), with v_{t+1} for G_{t+1} where the
    action of step t + 1 is not the policy's, as in Watkins' Q(lambda): what follows from that one
    says nothing of the policy. Nothing is expected after the end.
    """
    discount, trace = decay
    found = np.zeros_like(played.rewards)
    value_after = return_after = np.zeros(played.rewards.shape[1])
    for step in reversed(range(len(found))):
        mixed = (1.0 - trace) * value_after + trace * return_after
        now = played.rewards[step] + discount * mixed
        found[step] = now
        value_after = values[step] * played.alive[step]
        return_after = np.where(off_policy[step], value_after, now * played.alive[step])
    return found


def _each(state: GreedyState, inputs: np.ndarray) -> np.ndarray:
    """The scaled value of each state [H, N]."""
    values = state.formula.values
    found = [values.value(state.params, each, step) for step, each in enumerate(inputs)]
    return np.stack(found).astype(float)


def _fitted(
    context: Context, state: GreedyState, random: np.random.Generator, terms: tuple[int, float]
) -> GreedyState:
    """The state after so many updates of the value by Adam, with a step size."""
    updates, pace = terms
    inputs = np.concatenate([each.inputs for each in state.kept], axis=1)
    steps = np.concatenate([each.steps for each in state.kept])
    targets = np.concatenate([each.targets for each in state.kept]) / state.scale
    left = np.maximum(0.0, 1.0 - steps / context.problem.horizon).astype(np.float32)
    columns = np.ascontiguousarray(inputs.T)
    params, (first, second, number) = dict(state.params), state.moments
    first, second = dict(first), dict(second)
    for _ in range(updates):
        chosen = random.integers(0, len(steps), min(_MINIBATCH, len(steps)))
        gradient = _gradient(params, columns[chosen], left[chosen], targets[chosen])
        number += 1
        for name, slope in gradient.items():
            first[name] = _DECAYS[0] * first[name] + (1.0 - _DECAYS[0]) * slope
            second[name] = _DECAYS[1] * second[name] + (1.0 - _DECAYS[1]) * slope**2
            mean = first[name] / (1.0 - _DECAYS[0] ** number)
            size = np.sqrt(second[name] / (1.0 - _DECAYS[1] ** number)) + 1e-8
            params[name] = (params[name] - pace * mean / size).astype(np.float32)
    if not all(np.all(np.isfinite(value)) for value in params.values()):
        return state
    return state._replace(params=params, moments=(first, second, number))


def _gradient(params: Params, inputs: np.ndarray, left: np.ndarray, targets: np.ndarray) -> Params:
    """Of the mean squared error of the value, with inputs [M, size]."""
    hidden = inputs @ params["hidden"] + params["bias"] + left[:, None] * params["bias_left"]
    active = np.maximum(hidden, 0.0)
    output = params["output"] + left[:, None] * params["output_left"]
    value = inputs @ params["direct"] + left * (inputs @ params["direct_left"])
    value += np.einsum("mu,mu->m", active, output)
    error = (2.0 / len(left) * (value - targets)).astype(np.float32)
    of_left = error * left
    back = error[:, None] * output * (hidden > 0.0)
    return {
        "direct": inputs.T @ error,
        "direct_left": inputs.T @ of_left,
        "hidden": inputs.T @ back,
        "bias": back.sum(axis=0),
        "bias_left": left @ back,
        "output": active.T @ error,
        "output_left": active.T @ of_left,
    }
