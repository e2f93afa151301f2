"""What to play in a belief, from a policy of the underlying MDP: compiled.

Where the policy tells what actions are worth in a state, the action is played that is worth most on
average over the particles: QMDP, of Littman, Cassandra and Kaelbling, "Learning policies for
partially observable environments: scaling up" (1995). A likely small gain then does not outweigh a
less likely large loss. A table of the optimum with its values tells it,

    Q_t(s, a) = r(s, a) + g V_{t+1}(s'),

with the same random numbers for all actions, and so do the gains of `GreedyPlan`, of changes of the
no-op that count as independent.

Elsewhere each particle votes for what the policy plays in its state: action voting, of Simmons and
Koenig, "Probabilistic robot navigation in partially observable environments" (1995).
"""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, random

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan
from mdpo_rddl.planner.plans.legal import LegalActions
from mdpo_rddl.planner.programs.staging import with_fast_random_numbers
from mdpo_rddl.planner.start import initial_values
from mdpo_rddl.planner.upstream import INVALID_PARAMETERS
from mdpo_rddl.policy.lookahead.base import Prepared, Tabled, rollout_params
from mdpo_rddl.policy.lookahead.table_lookup import TableArrays, TableLookup
from mdpo_rddl.problem.limits import group_limits

Tree = Mapping[str, Any]
Elect = Callable[[Array, Any, dict[str, Array]], Mapping[str, Array]]
"""Of a random key, a step and particles [P, *shape], the action per fluent [*shape]."""

_HASH_SEED = 0
# particles that vote, or tell what they gain
_MOST_VOTERS = 512
# actions that are tried in a belief, and steps of the model for all of them together: the more
# actions, the fewer particles
_MOST_ACTIONS, _MOST_STEPS = 64, 2**13


def compiled_election(planner: MDPOPlanner, underlying: Prepared | Tabled) -> Elect:
    """What says which action to play in a belief.

    Args:
      planner: of the problem whose state is observed in part only.
      underlying: a policy of the underlying MDP.

    Raises:
      InputError: if the underlying policy cannot be played in compiled code.
    """
    is_joint = _is_joint(planner)
    if isinstance(underlying, Tabled):
        try:
            lookup = TableLookup(underlying.table)
        except ValueError as error:
            raise InputError(f"the underlying MDP's policy cannot be played: {error}") from error
        voted = _voted(lookup.policy, {}, {}, is_joint)
        has_values = lookup.arrays.values is not None
        cost = underlying.problem.error_cost
        elect = _worth_most(planner, lookup, cost) if has_values else voted
        return _jitted(elect, lookup.arrays)
    own = underlying.planner
    if own.plan.history_dependent or own.preprocessor is not None:
        raise InputError("the underlying MDP's policy reads more than the state")
    fluents = {n: jnp.asarray(v[0]) for n, v in initial_values(own).test.fluents.items()}
    if isinstance(own.plan, GreedyPlan) and not own.plan.is_in_turn:
        elect = _gaining_most(own.plan, is_joint)
    else:
        given = underlying.policy_hyperparams, fluents, is_joint
        elect = _voted(underlying.rollout_policy, *given)
    return _jitted(elect, rollout_params(underlying))


def _jitted(elect: Callable[..., Mapping[str, Array]], params: Any) -> Elect:
    # a large table is handed over once
    compiled, params = jax.jit(elect), jax.device_put(params)
    return lambda key, step, particles: compiled(key, params, step, particles)


def _voted(
    play: Callable[..., Tree], hyperparams: Tree, fluents: Tree, is_joint: bool
) -> Callable[..., Mapping[str, Array]]:
    """The vote of what a policy plays.

    Args:
      play: the policy, as a planner's.
      hyperparams: of it.
      fluents: that it may read beside the state's.
      is_joint: as `elected` takes it.
    """

    def elect(key: Array, params: Any, step: Any, particles: dict[str, Array]) -> Tree:
        def choose(own_key: Array, particle: dict[str, Array]) -> Tree:
            state = {
                name: jnp.asarray(value, fluents[name].dtype) if name in fluents else value
                for name, value in particle.items()
            }
            return play(own_key, params, hyperparams, step, {**fluents, **state}, {})

        particles = _spread_out(particles, _MOST_VOTERS)
        keys = random.split(key, _count(particles))
        chosen = jax.vmap(with_fast_random_numbers(choose))(keys, particles)
        return _of_votes(chosen, is_joint)

    return elect


def _gaining_most(plan: GreedyPlan, is_joint: bool) -> Callable[..., Mapping[str, Array]]:
    """The changes that gain on average, made legal in each particle: mostly the same in all."""

    def elect(key: Array, params: Any, step: Any, particles: dict[str, Array]) -> Tree:
        def gains(own_key: Array, particle: dict[str, Array]) -> Array:
            return plan.gains(params, own_key, particle, step, samples=1)

        particles = _spread_out(particles, _MOST_VOTERS)
        keys = random.split(key, _count(particles))
        mean = jnp.mean(jax.vmap(with_fast_random_numbers(gains))(keys, particles), axis=0)
        return _of_votes(jax.vmap(plan.choose, (None, 0))(mean, particles), is_joint)

    return elect


def _worth_most(
    planner: MDPOPlanner, lookup: TableLookup, error_cost: float
) -> Callable[..., Mapping[str, Array]]:
    """The table's action of the largest Q on average, in as many particles as there is time for.

    Of many actions those are tried that some particles would play, and the no-op. An action that is
    illegal in a particle's state is worth there what the no-op is, or, where that is illegal, too,
    the worst legal one; one that is illegal in all of them is not played. Where errors of the
    environment cost something in the table's problem, they do at the step at hand as well.
    """
    exact = planner.test_compiled
    fluents, nonfluents = exact.split_fluent_nonfluent(exact.init_values)
    transition = exact.compile_transition(check_constraints=True)
    model, discount = exact.model_aux["params"], float(planner.rddl.discount)
    legal = LegalActions(exact, group_limits(planner.rddl)[0])

    def worth(key: Array, arrays: TableArrays, step: Any, action: Tree, particle: Tree) -> Array:
        before = {**fluents, **particle, **action}
        after, log, _ = transition(key, action, before, nonfluents, model)
        ended = log["termination"] | ~log["invariant"]
        later = jnp.where(ended, 0.0, lookup.value(arrays, step + 1, after))
        reward = log["reward"]
        if error_cost:
            reward -= error_cost * ((log["error"] & INVALID_PARAMETERS) != 0)
        return reward + discount * later

    def elect(key: Array, params: Any, step: Any, particles: dict[str, Array]) -> Tree:
        actions = {name: jnp.asarray(each) for name, each in params.actions.items()}
        tried = _tried(lookup, params, step, particles)
        fewer = _spread_out(particles, max(1, _MOST_STEPS // len(tried)))

        def of_one(own_key: Array, particle: Tree) -> tuple[Array, Array]:
            def of_action(number: Array) -> tuple[Array, Array]:
                action = {name: each[number] for name, each in actions.items()}
                total = worth(own_key, params, step, action, particle)
                return total, legal.is_legal(action, particle)

            totals, is_legal = jax.vmap(of_action)(tried)
            worst = jnp.min(totals, where=is_legal, initial=jnp.inf)
            instead = jnp.where(is_legal[0] | jnp.isinf(worst), totals[0], worst)
            return jnp.where(is_legal, totals, instead), is_legal

        keys = random.split(key, _count(fewer))
        totals, is_legal = jax.vmap(with_fast_random_numbers(of_one))(keys, fewer)
        means = jnp.mean(totals, axis=0)
        is_known = jnp.any(is_legal, axis=0) & ~jnp.isnan(means)
        best = tried[jnp.argmax(jnp.where(is_known, means, -jnp.inf))]
        return {name: each[best] for name, each in actions.items()}

    return elect


def _tried(lookup: TableLookup, arrays: TableArrays, step: Any, particles: Tree) -> Array:
    """The numbers of the actions to try; the first one, 0, is the no-op."""
    count = len(next(iter(arrays.actions.values())))
    if count <= _MOST_ACTIONS:
        return jnp.arange(count)
    some = _spread_out(particles, _MOST_ACTIONS - 1)
    voted = jax.vmap(lambda particle: lookup.number(arrays, step, particle))(some)
    return jnp.concatenate([jnp.zeros(1, voted.dtype), voted])


def _spread_out(particles: Tree, most: int) -> dict[str, Array]:
    """So many particles at most, by even distances: they lie in the order of their origins."""
    stride = -(-_count(particles) // most)
    return {name: value[::stride] for name, value in particles.items()}


def _count(particles: Tree) -> int:
    return len(jax.tree.leaves(dict(particles))[0])


def _of_votes(actions: Tree, is_joint: bool) -> dict[str, Array]:
    """The elected one of actions per fluent [P, *shape]."""
    count = _count(actions)
    flat = [jnp.reshape(value, (count, -1)).astype(jnp.float32) for value in actions.values()]
    place = elected(jnp.concatenate(flat, axis=1), is_joint)
    return {name: value[place] for name, value in actions.items()}


def elected(votes: Array, is_joint: bool) -> Array:
    """Whose action is elected: the place of a vote.

    Args:
      votes: of P particles, over the D components of an action [P, D].
      is_joint: whether the action with the most votes is elected; else the one that is nearest to
        the median of each component, distances in standard deviations.
    """
    if is_joint:
        factors = random.bits(random.PRNGKey(_HASH_SEED), (votes.shape[1],), jnp.uint32) | 1
        bits = jax.lax.bitcast_convert_type(votes, jnp.uint32)
        codes = jnp.sum(bits * factors, axis=1, dtype=jnp.uint32)
        return jnp.argmax(jnp.sum(codes[:, None] == codes, axis=1))
    spread = jnp.std(votes, axis=0)
    weights = jnp.where(spread > 0.0, 1.0 / jnp.where(spread > 0.0, spread, 1.0), 0.0)
    away = jnp.abs(votes - jnp.median(votes, axis=0))
    return jnp.argmin(jnp.sum(weights * away, axis=1))


def _is_joint(planner: MDPOPlanner) -> bool:
    """Whether no action lies between others: one component may be set, or one is an object."""
    rddl = planner.rddl
    kinds = {rddl.variable_ranges[name] for name in rddl.action_fluents}
    is_single = rddl.max_allowed_actions == 1 and kinds == {"bool"}
    return is_single or not kinds <= {"bool", "int", "real"}
