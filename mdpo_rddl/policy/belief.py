"""What is believed of a hidden state, and what to play in such a belief.

A particle filter on the simulator follows each episode: Gordon, Salmond and Smith, "Novel approach
to nonlinear/non-Gaussian Bayesian state estimation" (1993). A policy of the underlying MDP, which
sees the state, says what to play in each particle's:

- where that tells what actions are worth in a state, a table with values or the greedy policy of
  one, the action that is worth most on average over the particles: QMDP, of Littman, Cassandra and
  Kaelbling, "Learning policies for partially observable environments: scaling up" (1995). A likely
  small gain then does not outweigh a less likely large loss;
- of others the action that most particles would play: action voting, of Simmons and Koenig,
  "Probabilistic robot navigation in partially observable environments" (1995).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.policy.formula import FeedbackFormula, require_count
from mdpo_rddl.policy.greedy import GreedyFormula
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.simulator.common import CommonNumbers
from mdpo_rddl.simulator.evaluation import Replicated
from mdpo_rddl.simulator.simulator import Simulator, State, Step

Arrays = Mapping[str, np.ndarray]
Elect = Callable[[int, State, int], Arrays]
"""(step, state per fluent [*shape, B V], B) -> action per fluent [*shape, B]; the V particles of an
episode are side by side."""

PARTICLES = 256
"""Of an episode: on five problems eight times as many return no more (64 return less on one)."""
# of these, that say what to play; where a plan is made in each of them, which takes milliseconds;
# where each change of the no-op is tried
_VOTERS, _PLANNING, _GAINING = 64, 8, 16
# actions of a table that are tried in a belief, and steps of the model for all of them together:
# the more actions, the fewer particles
_MOST_ACTIONS, _MOST_STEPS = 64, 1024
# log-likelihood of a component that cannot be: with it, the fewest mismatches weigh most
_LEAST = -30.0
# of a scale: what rounding may differ by
_ROUNDING = 1e-4


class Belief(NamedTuple):
    """Particles of B episodes.

    Attributes:
      particles: per fluent that is no action [*shape, B P].
      actions: that were played since, per action fluent [*shape, B]; None before a decision.
    """

    particles: State
    actions: Arrays | None = None


class BeliefFilter:
    """Follows B episodes, each with P particles of the same weight."""

    def __init__(self, simulator: Simulator, seed: int, particles: int = PARTICLES) -> None:
        """Believes nothing yet.

        Args:
          simulator: of a problem whose state is observed in part only.
          seed: of all draws.
          particles: P.
        """
        self._simulator, self._seed, self.count = simulator, seed, particles
        self._ranges = simulator.problem.model.variable_ranges

    def start(self, episodes: int) -> Belief:
        """The initial state, which is known."""
        return Belief(self._simulator.initial(episodes * self.count))

    def advance(self, belief: Belief, step: int, seen: Arrays) -> Belief:
        """The belief after a step.

        Args:
          belief: before it, with the actions that were played.
          step: decisions before the next one.
          seen: per observation fluent [*shape, B].
        """
        assert belief.actions is not None
        played = {n: np.repeat(each, self.count, axis=-1) for n, each in belief.actions.items()}
        chances: dict[str, np.ndarray] = {}
        given = self._simulator, belief.particles, played
        after = stepped(*given, [self._seed, step], self.count, chances)
        # whoever still observes has seen the episode go on
        ended = after.terminated | after.broken | after.errors
        logs = np.where(ended, _LEAST, 0.0).reshape(-1, self.count)
        for name, value in seen.items():
            logs = logs + self._likelihood(name, value, after.state[name], chances.get(name))
        places = resampled(np.random.default_rng([self._seed, step, 1]).random(), logs)
        return Belief({name: value[..., places] for name, value in after.state.items()})

    def _likelihood(
        self, name: str, seen: np.ndarray, drawn: np.ndarray, chance: np.ndarray | None
    ) -> np.ndarray:
        """Log-likelihood of what was seen of a fluent, by particle [B, P].

        Of a bool by its chance, where the model states that; a real is weighed by its distance from
        the particle's own draw; everything else must equal that.
        """
        seen = np.reshape(seen, (-1, seen.shape[-1], 1))
        drawn = drawn.reshape(len(seen), -1, self.count)
        with np.errstate(all="ignore"):
            if chance is not None:
                chance = chance.reshape(drawn.shape)
                logs = np.log(np.where(seen, chance, 1.0 - chance))
            elif self._ranges[name] == "real":
                logs = kernel(seen - drawn)
            else:
                logs = np.where(seen == drawn, 0.0, _LEAST)
        return np.maximum(np.nan_to_num(logs, nan=_LEAST), _LEAST).sum(axis=0)


def kernel(distances: np.ndarray) -> np.ndarray:
    """Log-weights by a normal kernel with Silverman's bandwidth, 1.06 sd P^(-1/5).

    Args:
      distances: of the particles [..., P].
    """
    known = np.where(np.isfinite(distances), distances, np.nan)
    with np.errstate(all="ignore"):
        spread = 1.06 * np.nanstd(known, axis=-1, keepdims=True) * known.shape[-1] ** -0.2
        nearest = np.nanmin(np.abs(known), axis=-1, keepdims=True)
    # where all particles agree
    return -0.5 * np.square(known / np.maximum(spread, _ROUNDING * (1.0 + nearest)))


def resampled(uniform: float, logs: np.ndarray) -> np.ndarray:
    """Systematic resampling: particle i of an episode comes P w_i times, rounded up or down.

    Args:
      uniform: on [0, 1).
      logs: log-weights [B, P].

    Returns:
      Places among all particles [B P], each episode's in order.
    """
    episodes, count = logs.shape
    weights = np.exp(logs - logs.max(axis=1, keepdims=True))
    sums = np.cumsum(weights, axis=1) / weights.sum(axis=1, keepdims=True)
    sums[:, -1] = 1.0
    points = (np.arange(count) + uniform) / count
    # episode b's sums and points lie between b and b + 1
    of_all = np.arange(episodes)[:, np.newaxis]
    return np.searchsorted((sums + of_all).ravel(), (points + of_all).ravel(), "right")


def stepped(
    simulator: Simulator,
    state: State,
    actions: Arrays,
    seed: Any,
    count: int,
    chances: dict[str, np.ndarray] | None = None,
) -> Step:
    """A step, in which all episodes have the same random numbers, however many there are.

    Args:
      simulator: of the problem.
      state: per fluent [*shape, B count].
      actions: per action fluent [*shape, B count].
      seed: of the draws.
      count: replicas of an episode.
      chances: as `Simulator.step` takes it.
    """
    total = next(iter(state.values())).shape[-1]
    at_once = count * max(1, simulator.block // count)
    parts, known = [], []
    for first in range(0, total, at_once):
        which = slice(first, min(first + at_once, total))
        groups = (which.stop - first) // count
        random = np.random.default_rng(seed)
        own: dict[str, np.ndarray] = {}
        some, played = ({n: v[..., which] for n, v in tree.items()} for tree in (state, actions))
        common = random if groups == 1 else CommonNumbers(random, np.tile(np.arange(count), groups))
        parts.append(simulator.step(some, played, common, None if chances is None else own))
        known.append(own)

    def joined(trees: Sequence[Any]) -> dict[str, np.ndarray]:
        return {name: np.concatenate([t[name] for t in trees], axis=-1) for name in trees[0]}

    if chances is not None:
        chances.update(joined(known))
    rest = (np.concatenate(each) for each in list(zip(*parts, strict=True))[1:])
    return Step(joined([each.state for each in parts]), *rest)


def voting(simulator: Simulator, play: Replicated, by_plans: bool = False) -> Elect:
    """Elects what most particles would play.

    Where an action may lie between others, that is the action nearest to the median of each
    component, distances in standard deviations.

    Args:
      simulator: of the problem whose state is hidden.
      play: the underlying MDP's policy.
      by_plans: whether it makes plans, which takes long.
    """
    model = simulator.problem.model
    most = _PLANNING if by_plans else _VOTERS
    kinds = {model.variable_ranges[name] for name in simulator.actions}
    is_single = model.max_allowed_actions == 1 and kinds == {"bool"}
    is_joint = is_single or not kinds <= {"bool", "int", "real"}

    def elect(step: int, particles: State, episodes: int) -> Arrays:
        some = _spread_out(particles, episodes, most)
        chosen = play(step, some)
        count = next(iter(some.values())).shape[-1]
        full = {
            name: np.broadcast_to(each, (*simulator.shapes[name], count))
            for name, each in chosen.items()
        }
        flat = np.concatenate([np.reshape(each, (-1, count)) for each in full.values()])
        votes = flat.astype(float).reshape(len(flat), episodes, -1)
        places = elected(votes, is_joint) + np.arange(episodes) * votes.shape[-1]
        return {name: each[..., places] for name, each in full.items()}

    return elect


def gaining(formula: GreedyFormula, params: Any, seed: int) -> Elect:
    """Elects the changes of the no-op that gain on average over the particles.

    Args:
      formula: of the underlying MDP's greedy policies.
      params: of one of them.
      seed: of what it draws.
    """

    params = {name: np.asarray(each) for name, each in params.items()}

    def elect(step: int, particles: State, episodes: int) -> Arrays:
        some = _spread_out(particles, episodes, _GAINING)
        with np.errstate(all="ignore"):
            gains = formula.gains(params, some, step, [seed, step])
            means = gains.reshape(len(gains), episodes, -1).mean(axis=-1)
            # made legal in a particle of each episode: mostly the same in all
            return formula.choose(means, _spread_out(particles, episodes, 1))

    return elect


def worth_most(simulator: Simulator, policy: TablePolicy, seed: int) -> Elect:
    """Elects the action of a table of the largest Q on average,

        Q_t(s, a) = r(s, a) + g V_{t+1}(s'),

    with the same random numbers for all actions. Of many actions those are tried that most
    particles would play, and the no-op. An action that is illegal in a particle's state is worth
    there what the no-op is, or, where that is illegal, too, the worst legal one; one that is
    illegal in all of them, or raises an error in one, is not played.

    Args:
      simulator: of the problem whose state is hidden.
      policy: of the underlying MDP, with values.
      seed: of the steps.
    """
    actions, model = policy.table.actions, simulator.problem.model
    count = len(next(iter(actions.values())))
    cost = policy.problem.error_cost

    def elect(step: int, particles: State, episodes: int) -> Arrays:
        tried = np.arange(count)
        if count > _MOST_ACTIONS:
            some = _spread_out(particles, episodes, _VOTERS)
            tally = np.bincount(policy.numbers(step, _batch(some)), minlength=count)
            tally[0] = len(tried) * episodes  # the no-op is the first one
            tried = np.sort(np.argsort(-tally, kind="stable")[:_MOST_ACTIONS])
        some = _spread_out(particles, episodes, max(1, _MOST_STEPS // len(tried)))
        replicas = next(iter(some.values())).shape[-1]
        totals = np.zeros((len(tried), replicas))
        legal = np.zeros((len(tried), replicas), bool)
        for row, number in enumerate(tried):
            action = {
                name: np.broadcast_to(each[number][..., np.newaxis], (*each.shape[1:], replicas))
                for name, each in actions.items()
            }
            legal[row] = simulator.legal(some, action)
            after = stepped(simulator, some, action, [seed, step], replicas // episodes)
            ended = after.terminated | after.broken
            states = {name: after.state[name] for name in model.state_fluents}
            later = np.where(ended, 0.0, policy.values(step + 1, _batch(states)))
            totals[row] = after.rewards + model.discount * later
            totals[row, after.errors] = -cost if cost else -np.inf
        worst = np.min(totals, axis=0, where=legal, initial=np.inf)
        instead = np.where(legal[0] | np.isinf(worst), totals[0], worst)
        means = np.where(legal, totals, instead).reshape(len(tried), episodes, -1).mean(axis=-1)
        is_known = legal.reshape(len(tried), episodes, -1).any(axis=-1) & ~np.isnan(means)
        best = tried[np.argmax(np.where(is_known, means, -np.inf), axis=0)]
        return {name: np.moveaxis(each[best], 0, -1) for name, each in actions.items()}

    return elect


def _batch(states: State) -> dict[str, np.ndarray]:
    """States with the axis of replicas first."""
    return {name: np.moveaxis(value, -1, 0) for name, value in states.items()}


def elected(votes: np.ndarray, is_joint: bool) -> np.ndarray:
    """Whose action is elected in each episode [B].

    Args:
      votes: of V particles, over the D components of an action [D, B, V].
      is_joint: whether the action with the most votes is elected, or the one nearest to the median
        of each component.
    """
    if not is_joint:
        spread = votes.std(axis=-1, keepdims=True)
        weights = np.divide(1.0, spread, out=np.zeros_like(spread), where=spread > 0.0)
        away = np.abs(votes - np.median(votes, axis=-1, keepdims=True))
        return np.argmin((weights * away).sum(axis=0), axis=-1)
    components, episodes, count = votes.shape
    # equal votes have equal codes, and others hardly ever: wrapping sums of their bits
    factors = np.random.default_rng(0).integers(2**62, size=(components, 1, 1)) * 2 + 1
    codes = (np.ascontiguousarray(votes).view(np.int64) * factors).sum(axis=0)
    numbers = np.unique(codes.ravel(), return_inverse=True)[1].reshape(episodes, count)
    kinds = numbers.max() + 1
    offset = np.arange(episodes)[:, np.newaxis] * kinds
    tally = np.bincount((numbers + offset).ravel(), minlength=episodes * kinds)
    most = tally.reshape(episodes, kinds).argmax(axis=1)
    return np.argmax(numbers == most[:, np.newaxis], axis=1)


def _spread_out(particles: State, episodes: int, most: int) -> State:
    """So many particles of each episode, by even distances: they lie in the order of origins."""
    count = next(iter(particles.values())).shape[-1] // episodes
    stride = max(1, count // most)
    return {
        name: value.reshape(*value.shape[:-1], episodes, count)[..., ::stride].reshape(
            *value.shape[:-1], -1
        )
        for name, value in particles.items()
    }


class BeliefReplicas:
    """Plays B episodes at once by what is elected in their beliefs.

    A step that is asked for again is the same decision again; episodes begin at step 0, and at a
    step that does not follow the last.
    """

    def __init__(self, simulator: Simulator, elect: Elect, seed: int) -> None:
        """Has seen nothing yet.

        Args:
          simulator: of a problem whose state is observed in part only.
          elect: says what to play in a belief.
          seed: of the filter.
        """
        self._filter, self._elect = BeliefFilter(simulator, seed), elect
        self._states = list(simulator.problem.model.state_fluents)
        self._step = -1
        self._before: Belief | None = None
        self._now: Belief | None = None

    def __call__(self, step: int, observation: Arrays) -> Arrays:
        """Per action fluent [*shape, B]."""
        episodes = next(iter(observation.values())).shape[-1]
        if step == self._step + 1 and step:
            self._before = self._now
        elif step == 0 or step != self._step:
            self._before = None
        self._step = step
        if self._before is None:
            belief = self._filter.start(episodes)
        else:
            assert self._before.actions is not None
            known = next(iter(self._before.actions.values())).shape[-1]
            require_count(known, episodes, step)
            belief = self._filter.advance(self._before, step, observation)
        states = {name: belief.particles[name] for name in self._states}
        actions = self._elect(step, states, episodes)
        self._now = belief._replace(actions=actions)
        return actions

    @property
    def belief(self) -> Belief | None:
        """At the latest decision, with what was played; None before the first."""
        return self._now

    def were_played(self, actions: Arrays) -> None:
        """Takes in what was played instead at the latest step."""
        if self._now is not None:
            self._now = self._now._replace(actions=dict(actions))


class BeliefPlay:
    """The same as environments play it: step by step, one episode or several."""

    def __init__(self, formula: FeedbackFormula, replicas: Callable[[], BeliefReplicas]) -> None:
        """Has seen nothing yet.

        Args:
          formula: of the problem, which knows what environments show and take.
          replicas: makes what plays.
        """
        self._formula, self._replicas = formula, replicas
        self.reset()

    def __call__(self, step: int, state: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """The action per fluent [*shape] at a step, for an observation per fluent."""
        each = {name: np.asarray(value)[np.newaxis] for name, value in state.items()}
        actions = self._one(step, self._formula.seen(step, each))
        return {name: value[0] for name, value in self._formula.shown(actions).items()}

    @property
    def belief(self) -> Belief | None:
        """Of the one episode, see `BeliefReplicas.belief`."""
        return self._one.belief

    def was_played(self, actions: Mapping[str, Any]) -> None:
        """Takes in what was played at the latest step, per action fluent [*shape]."""
        each = {name: np.asarray(value)[np.newaxis] for name, value in actions.items()}
        self._one.were_played(self._formula.played(each))

    def batch(self, step: int, observations: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """The actions for several episodes at one step, per fluent [batch, *shape]."""
        return self._formula.shown(self._many(step, self._formula.seen(step, observations)))

    def were_played(self, actions: Mapping[str, Any]) -> None:
        """Takes in what was played at the latest step of `batch`, per fluent [batch, *shape]."""
        self._many.were_played(self._formula.played(actions))

    def reset(self) -> None:
        """Forgets the episodes."""
        self._one, self._many = self._replicas(), self._replicas()
