"""The compiled exact model against the environment, on the same sequences of actions."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.planner.rollouts.compiled import RolloutOptions, compile_rollouts
from mdpo_rddl.planner.rollouts.termination import steps_alive
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import episode_seeds, evaluate
from mdpo_rddl.problem.load import Problem, make_environment

_EPISODES, _ROLLOUTS = 30, 256
_SEQUENCES = 3
# a difference in distribution: so many standard errors
_MOST_ERRORS = 4.5
# of a reward, or of 1 if it is smaller: 32-bit numbers and their sums
_TOLERANCE = 1e-3
_SIDE_BY_SIDE, _SIDE_ROLLOUTS = 64, 16
_SPEED_SECONDS = 2.0
# policies from nearly the no-op to nearly always the same
_SPREADS = (0.1, 1.0, 3.0)


class Agreement(NamedTuple):
    """How the two compare.

    Attributes:
      chance: whether rollouts of one sequence of actions differ.
      difference: in words; empty if there is none.
      illegal: steps at which the environment refused what a legal policy did, of all `steps`.
      steps: that the legal policies played.
    """

    chance: bool
    difference: str
    illegal: int
    steps: int


class Episodes(NamedTuple):
    """Rewards of episodes [B, H], zero after their ends, and their numbers of steps [B]."""

    rewards: np.ndarray
    lengths: np.ndarray


def compare(problem: Problem) -> Agreement:
    """Plays random actions, then random legal policies, on both.

    Rollouts that are all the same must agree step by step; others in the means of return and
    length.
    """
    planner = make_planner(problem)
    chance, differences = False, []
    compiled = compile_sequences(planner, _ROLLOUTS)
    for number in range(_SEQUENCES):
        actions = random_actions(problem, np.random.default_rng([0, number]))
        ours = compiled(jax.random.PRNGKey(number), actions)
        chance |= is_random(ours)
        theirs = _environment_episodes(problem, actions, _EPISODES if chance else 1)
        differences.append(difference(ours, theirs))
    policies = random_policies(planner, _SPREADS)
    returns = compile_exact_returns(planner, _ROLLOUTS)(jax.random.PRNGKey(1), policies)
    illegal = steps = 0
    env = make_environment(problem)
    for number, ours_each in enumerate(np.asarray(returns, float)):
        one = jax.tree.map(lambda leaf, n=number: leaf[n], policies)
        chance_here = bool(np.ptp(ours_each) > 0)
        episodes = _EPISODES if chance_here else 1
        played = evaluate(env, playable(planner, one, {}, 0), episodes, number)
        illegal, steps = illegal + played.illegal_actions, steps + int(np.sum(played.lengths))
        scale = 1.0 if chance_here else math.sqrt(problem.horizon)
        differences.append(_mean_difference("return", ours_each, played.returns, scale))
    found = [text for text in differences if text]
    return Agreement(chance, found[0] if found else "", illegal, steps)


def steps_per_second(problem: Problem) -> float:
    """Of 64 policies times 16 rollouts of the exact model, policy included.

    The seconds are those that all threads have computed: what one core would take on its own.
    """
    planner = make_planner(problem)
    play = compile_exact_returns(planner, _SIDE_ROLLOUTS)
    policies = random_policies(planner, np.resize(_SPREADS, _SIDE_BY_SIDE))
    jax.block_until_ready(play(jax.random.PRNGKey(0), policies))
    calls, started, used = 0, time.perf_counter(), time.process_time()
    while time.perf_counter() - started < _SPEED_SECONDS:
        calls += 1
        jax.block_until_ready(play(jax.random.PRNGKey(calls), policies))
    steps = calls * _SIDE_BY_SIDE * _SIDE_ROLLOUTS * planner.horizon
    return steps / (time.process_time() - used)


def difference(ours: Episodes, theirs: Episodes) -> str:
    """What differs, in words; nothing if the two agree."""
    if is_random(ours):
        texts = [
            _mean_difference("return", np.sum(ours.rewards, 1), np.sum(theirs.rewards, 1)),
            _mean_difference("length", ours.lengths, theirs.lengths),
        ]
        return next((text for text in texts if text), "")
    mine, its = ours.rewards[0], theirs.rewards[0]
    if ours.lengths[0] != theirs.lengths[0]:
        return f"{ours.lengths[0]:.0f} steps, the environment {theirs.lengths[0]:.0f}"
    close = np.isclose(mine, its, rtol=_TOLERANCE, atol=_TOLERANCE, equal_nan=True)
    if np.all(close):
        return ""
    step = int(np.argmin(close))
    return f"reward {mine[step]:.6g} at step {step}, the environment {its[step]:.6g}"


def is_random(episodes: Episodes) -> bool:
    """Whether not all episodes of the same actions are the same."""
    rewards = np.nan_to_num(episodes.rewards)
    return bool(np.any(np.ptp(rewards, axis=0) > 0) or np.ptp(episodes.lengths) > 0)


def random_actions(problem: Problem, random: np.random.Generator) -> dict[str, np.ndarray]:
    """Actions for each step [H, *shape] in their boxes, as many as `max-nondef-actions` allows."""
    env = make_environment(problem)
    model, noop = problem.model, env.sampler.noop_actions
    steps = [
        {name: np.array(value) for name, value in noop.items()} for _ in range(problem.horizon)
    ]
    places = [
        (name, index) for name, value in noop.items() for index in np.ndindex(np.shape(value))
    ]
    for actions in steps:
        most = min(model.max_allowed_actions, len(places))
        for number in random.permutation(len(places))[: random.integers(most + 1)]:
            name, index = places[number]
            space = env.action_space[name]
            shape = np.shape(actions[name])
            ends = (np.resize(end, shape) for end in (space.low, space.high))
            lower, upper = (float(end[index]) for end in ends)
            center = float(actions[name][index])
            lower, upper = max(lower, center - 10.0), min(upper, center + 10.0)
            if model.action_ranges[name] == "real":
                actions[name][index] = random.uniform(lower, upper)
            else:
                actions[name][index] = random.integers(math.ceil(lower), math.floor(upper) + 1)
    return {name: np.stack([actions[name] for actions in steps]) for name in noop}


def make_planner(problem: Problem) -> MDPOPlanner:
    """A planner of the feedback policy, with a plan beside it; nothing is trained."""
    plan = FeedbackPlan(FeedbackShape(topology=(), plan=True))
    quiet = {"print_warnings": False}
    return MDPOPlanner(
        problem.model,
        plan,
        pgpe=None,
        batch_size_train=1,
        batch_size_test=1,
        rollout_horizon=problem.horizon,
        compiler_kwargs=quiet,
    )


def compile_sequences(
    planner: MDPOPlanner, rollouts: int
) -> Callable[[Array, Mapping[str, np.ndarray]], Episodes]:
    """So many rollouts of given actions [H, *shape] on the compiled model."""
    model = planner.test_compiled

    def policy(key, params, hyperparams, step, fluents, history):
        del key, hyperparams, fluents, history
        return {name: values[step] for name, values in params.items()}

    rollout = jax.jit(
        compile_rollouts(
            model,
            policy,
            planner.horizon,
            rollouts,
            RolloutOptions(check_constraints=True, differentiated=False),
        )
    )
    fluents, nonfluents = model.split_fluent_nonfluent(model.init_values)
    start = jax.tree.map(lambda v: jnp.repeat(jnp.asarray(v)[None], rollouts, 0), fluents)

    def play(key: Array, actions: Mapping[str, np.ndarray]) -> Episodes:
        cast = {name: jnp.asarray(v, start[name].dtype) for name, v in actions.items()}
        log, _ = rollout(key, cast, {}, start, nonfluents, model.model_aux["params"])
        alive = np.asarray(steps_alive(log["termination"] | ~log["invariant"]))
        rewards = np.where(alive > 0, np.asarray(log["reward"], float), 0.0)
        return Episodes(rewards, np.sum(alive, axis=1))

    return play


def _environment_episodes(
    problem: Problem, actions: Mapping[str, np.ndarray], episodes: int
) -> Episodes:
    env = make_environment(problem)
    rewards = np.zeros((episodes, problem.horizon))
    lengths = np.zeros(episodes)
    for episode, seed in enumerate(episode_seeds(0, episodes)):
        env.reset(seed=seed)
        step = 0
        while not env.done:
            now = {
                name: v[step] if v[step].shape else v[step].item() for name, v in actions.items()
            }
            _, rewards[episode, step], *_ = env.step(now)
            step += 1
        lengths[episode] = step
    return Episodes(rewards, lengths)


def random_policies(planner: MDPOPlanner, spreads: Sequence[float] | np.ndarray) -> Any:
    """Parameters of one policy for each spread, the standard deviation of its normal weights.

    Returns:
      A tree with a leading axis of policies; weights beyond the largest number of 32 bits are it.
    """
    random = np.random.default_rng(0)
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    largest = float(np.finfo(np.float32).max)

    def draw(leaf: Array) -> np.ndarray:
        values = random.normal(size=(len(spreads), *leaf.shape))
        values = values * np.reshape(spreads, (-1, *[1] * leaf.ndim))
        return np.clip(values, -largest, largest).astype(np.float32)

    return jax.tree.map(draw, params)


def _mean_difference(name: str, ours: np.ndarray, theirs: np.ndarray, slack: float = 1.0) -> str:
    means = float(np.mean(ours)), float(np.mean(theirs))
    error = math.hypot(
        *(
            float(np.std(v, ddof=1)) / math.sqrt(len(v)) if len(v) > 1 else 0.0
            for v in (ours, theirs)
        )
    )
    allowed = _MOST_ERRORS * error + slack * _TOLERANCE * max(1.0, abs(means[1]))
    if means[0] == means[1] or abs(means[0] - means[1]) <= allowed:
        return ""
    return f"mean {name} {means[0]:.6g}, the environment {means[1]:.6g} (error {error:.2g})"
