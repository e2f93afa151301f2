"""Weights of the feedback policy by covariance matrix adaptation, without a gradient.

Three scopes of one search (`mdpo_rddl.race.cma`), whose covariance is diagonal for many weights:

- random rules: simple rules, linear in the state and the same at all times, drawn at random;
- shared weights: those that all objects have in common; first those of a simple rule, from the best
  of random ones, then all of them, then again from other rules;
- own weights: shared ones and each object's own, around the best feedback policy so far.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.policy.formula import without_idle
from mdpo_rddl.problem.evaluation import LOST
from mdpo_rddl.race import cma
from mdpo_rddl.race.arm import Arm, Candidate, Context, Turn
from mdpo_rddl.race.weights import Params, Weights

RULES, SHARED, OWN = "random rules", "shared weights", "own weights"

# policies of an iteration, and episodes of each where chance plays a part: while it is drawn, while
# it is adapted
_POPULATION, _FEW, _EPISODES = 32, 2, 8
# random rules of a draw: most of a simple rule's weights are zero, some are large
_DRAWN, _SCALES, _SHARES = 256, (0.0, 0.5, 1.5), (0.5, 0.3, 0.2)
# one rule of four is stronger by a power of ten of up to: the scales of states are those of
# constants, far from where a rule holds them
_STRONGER = 2.0
# the first deviation of a weight: of a simple rule, of all weights, of own weights in turn
_SIMPLE_SIGMA, _ALL_SIGMA, _OWN_SIGMAS = 0.5, 0.1, (0.03, 0.1, 0.01)
_RELATIVE_SIGMA = 0.3
# an adaptation has stalled whose median return over the latest quarter of so many iterations or
# more is larger than over the quarter before by less than this share of all that it gained
_FEWEST, _LEAST_GAIN = 60, 0.01
# more weights than these have a diagonal covariance; of more than the second number only the shared
# ones vary
_MOST_FULL, _MOST = 100, 5000
# episodes in which what was found is compared with what was known
_COMPARED = 32
_WORST = -1e30
# of a lost episode, in ranges of the returns of others; and so many times more episodes are played
# where some are lost, to tell how rarely
_PENALTY, _LEAST, _TELLING = 10.0, 1e-3, 3


class _Adaptation(NamedTuple):
    """One run of CMA-ES.

    Attributes:
      weights: what its vectors stand for.
      search: where it is.
      medians: of the population's returns, of each iteration.
    """

    weights: Weights
    search: cma.Search
    medians: tuple[float, ...] = ()

    @property
    def has_stalled(self) -> bool:
        """Whether it gains little, or nothing can be told apart any more."""
        count = len(self.medians)
        if count and cma.is_over(self.search):
            return True
        if count < _FEWEST:
            return False
        quarter = count // 4
        before = float(np.mean(self.medians[-2 * quarter : -quarter]))
        now = float(np.mean(self.medians[-quarter:]))
        return now - before <= _LEAST_GAIN * max(0.0, now - self.medians[0])


class WeightsState(NamedTuple):
    """See `mdpo_rddl.race.arm.State`.

    Attributes:
      params: the best policy so far.
      adaptation: that goes on; None between two.
      begun: adaptations so far; of random rules the iteration of the best one.
      parent: whose policy the adaptation began with, if it was another arm's.
    """

    params: Params
    found: tuple[Candidate, ...] = ()
    claim: float = -np.inf
    iterations: int = 0
    adaptation: _Adaptation | None = None
    begun: int = 0
    parent: Candidate | None = None
    is_ready: bool = True
    is_exhausted: bool = False
    details: Mapping[str, Any] = {}


def rules() -> Arm:
    """Random rules, until many find none that is better; where none is paid, on and on."""

    def step(context: Context, state: WeightsState, turn: Turn) -> WeightsState:
        simple = _simple(context)
        drawn, state = _drawn(context, RULES, simple, state._replace(found=()), turn.until)
        state = _offered(context, state, RULES, simple.params(drawn[0]))
        if state.found:
            return state._replace(begun=state.iterations)
        is_paid = state.params is not context.family.noop
        idle = _POPULATION * (state.iterations - state.begun)
        return state._replace(is_exhausted=is_paid and idle >= _DRAWN)

    return Arm(RULES, lambda context: WeightsState(context.family.noop), step)


def shared_weights() -> Arm:
    """Weights that all objects have in common."""

    def begin(context: Context, state: WeightsState, turn: Turn) -> WeightsState:
        if state.parent is not None and not state.begun % 2:
            weights = _simple(context, state.parent.policy.params)
            # a strong rule has large weights
            start = weights.start
            sigma = max(_SIMPLE_SIGMA, _RELATIVE_SIGMA * float(np.sqrt(np.mean(start**2))))
        elif state.begun % 2:  # all weights, from the best so far
            base = _varied(state.params)
            weights = Weights(base, {"shared": _all(base["shared"])})
            start, sigma = weights.start, _ALL_SIGMA
        else:
            weights = _simple(context)
            drawn, state = _drawn(context, SHARED, weights, state)
            start, sigma = drawn[0], _SIMPLE_SIGMA
        adaptation = _adaptation(weights, start, sigma)
        return state._replace(adaptation=adaptation, begun=state.begun + 1)

    def step(context: Context, state: WeightsState, turn: Turn) -> WeightsState:
        known = turn.best_feedback
        rule = None if known is None or known.candidate.arm != RULES else known.candidate
        if rule is not None and rule is not state.parent:
            begun = state.begun + state.begun % 2
            state = state._replace(parent=rule, adaptation=None, begun=begun)
        return _adapted(context, state, turn, SHARED, begin)

    return Arm(SHARED, lambda context: WeightsState(context.family.noop), step, improves=True)


def own_weights() -> Arm:
    """Shared and own weights around the best feedback policy."""

    def step(context: Context, state: WeightsState, turn: Turn) -> WeightsState:
        leader = turn.best_feedback
        assert leader is not None
        parent = leader.candidate
        if parent is not state.parent and parent.arm != OWN:
            # somebody else leads now
            state = state._replace(parent=parent, adaptation=None)
        params = parent.policy.params

        def begin(context: Context, state: WeightsState, turn: Turn) -> WeightsState:
            base = _varied(params)
            full = {**base, "own": params["own"]}
            parts: tuple[str, ...] = "shared", "own"
            varies = {part: _all(full[part]) for part in parts}
            weights = Weights(full, varies)
            if weights.start.size > _MOST:
                weights = Weights(base, {"shared": varies["shared"]})
            sigma = _OWN_SIGMAS[state.begun % len(_OWN_SIGMAS)]
            adaptation = _adaptation(weights, weights.start, sigma)
            return state._replace(adaptation=adaptation, begun=state.begun + 1)

        state = state._replace(params=params, claim=leader.mean)
        return _adapted(context, state, turn, OWN, begin)

    return Arm(OWN, lambda context: WeightsState(context.family.noop), step, improves=True)


def _adapted(
    context: Context,
    state: WeightsState,
    turn: Turn,
    name: str,
    begin: Callable[[Context, WeightsState, Turn], WeightsState],
) -> WeightsState:
    """Goes on with adaptations until the turn ends, and offers what is better than before."""
    state = state._replace(found=())
    while True:
        if state.adaptation is None:
            state = begin(context, state, turn)
        assert state.adaptation is not None
        weights, search, medians = state.adaptation
        context.on_iteration()
        asked = cma.ask(search, _POPULATION, context.generator(name, state.iterations, 2))
        means = _means(context, weights, asked, [state.iterations, *name.encode()])
        search = cma.tell(search, asked, means)
        adaptation = _Adaptation(weights, search, (*medians, float(np.median(means))))
        state = state._replace(adaptation=adaptation, iterations=state.iterations + 1)
        is_over = context.budget.clock() >= turn.until
        if adaptation.has_stalled or is_over:
            found = weights.params(search.mean)
            state = _offered(context, state, name, found)
        if adaptation.has_stalled:
            state = state._replace(adaptation=None)
        if is_over:
            return state


def _adaptation(weights: Weights, start: np.ndarray, sigma: float) -> _Adaptation:
    return _Adaptation(weights, cma.begin(start, sigma, is_full=start.size <= _MOST_FULL))


def _offered(context: Context, state: WeightsState, name: str, params: Params) -> WeightsState:
    """The state with a policy in it, if that is better than the best so far."""
    both = [Weights(each, {}) for each in (without_idle(params), without_idle(state.params))]
    seed = [state.iterations, 1, *name.encode()]
    nothing, episodes = np.zeros((1, 0)), 1 if context.certain else _COMPARED
    means = [context.family.returns(each, nothing, episodes, seed).mean() for each in both]
    if not means[0] > means[1]:
        return state._replace(claim=max(state.claim, float(means[1])))
    parent = state.parent
    parents = () if parent is None else tuple(dict.fromkeys((*parent.parents, parent.arm)))
    noisy = parent is not None and parent.uses_noise
    candidate = Candidate(name, name, context.family.policy(params), parents, noisy)
    return state._replace(params=params, found=(*state.found, candidate), claim=float(means[0]))


def _drawn(
    context: Context, name: str, simple: Weights, state: WeightsState, until: float = np.inf
) -> tuple[np.ndarray, WeightsState]:
    """The best of random rules [P, D], the very best first; of fewer if the time is over."""
    random = context.generator(name, state.iterations, 1)
    best, means, episodes = np.zeros((0, simple.start.size)), np.zeros(0), [state.iterations]
    for _ in range(0, _DRAWN, _POPULATION):
        context.on_iteration()
        size = (_POPULATION, simple.start.size)
        vectors = random.normal(size=size) * random.choice(_SCALES, size=size, p=_SHARES)
        vectors[::4] *= 10.0 ** random.uniform(0.0, _STRONGER, size=(len(vectors[::4]), 1))
        new = _means(context, simple, vectors, [*episodes, *name.encode()], _FEW)
        best, means = np.concatenate([best, vectors]), np.concatenate([means, new])
        order = np.argsort(-means, kind="stable")[: _POPULATION // 2]
        best, means = best[order], means[order]
        state = state._replace(iterations=state.iterations + 1)
        if context.budget.clock() >= until:
            break
    return best[np.argsort(-_fresh(context, simple, best), kind="stable")], state


def _fresh(context: Context, weights: Weights, vectors: np.ndarray) -> np.ndarray:
    """Mean returns of vectors in episodes that they were not chosen by."""
    episodes = 1 if context.certain else _COMPARED
    return context.family.returns(weights, vectors, episodes, [0, *b"fresh"]).mean(axis=1)


def _means(
    context: Context,
    weights: Weights,
    vectors: np.ndarray,
    seed: Any,
    episodes: int = _EPISODES,
) -> np.ndarray:
    """Mean returns [P] of vectors [P, D]; those that are not finite are the worst.

    A lost episode counts as one that returns less than all others of the population by so many
    times their range: a policy that is seldom lost is near one that never is.
    """
    if context.certain:
        episodes = 1
    returns = context.family.returns(weights, vectors, episodes, [context.seed, *seed])
    lost = returns <= LOST
    if lost.any() and not lost.all():
        if not context.certain:
            more = [context.seed, *seed, 1]
            again = context.family.returns(weights, vectors, _TELLING * episodes, more)
            returns = np.concatenate([returns, again], axis=1)
            lost = returns <= LOST
        known = returns[~lost]
        worst = known.min() - _PENALTY * max(
            float(np.ptp(known)), _LEAST * abs(known.min()), _LEAST
        )
        returns = np.where(lost, worst, returns)
    return np.maximum(np.nan_to_num(returns.mean(axis=1), nan=_WORST), _WORST)


def _simple(context: Context, params: Params | None = None) -> Weights:
    """The shared weights of a simple rule, of a policy or of the no-op."""
    feedback = context.family.feedback
    varies = {
        name: np.array([not n.endswith("^2") and not n.startswith("cos(") for n in names])
        for name, names in ((n, feedback.names(n)) for n in feedback.action_shapes)
    }
    return Weights(_varied(params or context.family.noop), {"shared": varies})


def _varied(params: Params) -> Params:
    """What plays the same, with shared weights that have no effect yet."""
    return {**without_idle(params), "shared": params["shared"]}


def _all(tree: Any) -> Any:
    return {n: _all(v) if isinstance(v, Mapping) else True for n, v in tree.items()}
