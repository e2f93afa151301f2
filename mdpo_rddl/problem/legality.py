"""Actions that the exact environment accepts, whatever a policy proposes."""

import itertools
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from pyRDDLGym import RDDLEnv
from pyRDDLGym.core.debug.decompiler import RDDLDecompiler
from pyRDDLGym.core.debug.exception import RDDLInvalidActionError

from mdpo_rddl.problem.boxes import boxes
from mdpo_rddl.problem.episode import Verdict
from mdpo_rddl.problem.feasibility import LinearPreconditions

# by so much of itself a real number in 32 bit may be on the wrong side of a bound in 64 bit, and by
# more where the bound is a difference
_ROUNDING = (1e-6, 1e-5)
LARGEST_ROUNDING = max(_ROUNDING)
"""By so much of its distance from the no-op a legal real action is moved at most."""


def action_box(env: RDDLEnv) -> dict[str, tuple[Any, Any]]:
    """Lower and upper bound [*shape], infinite where there is none, of each action fluent."""
    bounds = boxes(env.sampler)
    return {name: bounds[name] for name in env.model.action_ranges}


class Referee:
    """Replaces illegal proposals, in the current state of one environment, by legal actions."""

    def __init__(self, env: RDDLEnv) -> None:
        """Reads the action box of a vectorized environment."""
        self._env = env
        ranges, box = env.model.action_ranges, action_box(env)
        self._box = {name: box[name] for name, kind in ranges.items() if kind == "real"}
        self._linear = LinearPreconditions(env, self._box)
        self._bools = [name for name, kind in ranges.items() if kind == "bool"]
        noop = dict(env.sampler.noop_actions)
        # of defaults outside of their box
        self._nearest = {
            name: _nearest(noop[name], box[name], kind)
            for name, kind in ranges.items()
            if kind in ("int", "real")
        }
        is_in_box = all(np.array_equal(noop[name], near) for name, near in self._nearest.items())
        self._idle = [noop] if is_in_box else [noop, noop | self._nearest]
        # of the first state in which nothing legal was found
        self._unmet: tuple[str, ...] | None = None

    def rule(self, proposal: Mapping[str, Any]) -> Verdict:
        """The proposal if it is legal, else the first legal one of `_fallbacks`.

        Real actions are clipped to their box in 64 bit first, since a bound rounded to 32 bit
        can lie outside; one that is not finite is illegal. Where a bound depends on the state, what
        is legal once its real actions are rounded counts as legal; a number on a strict bound is
        moved off it so, and where an equality misses its last bits, one number takes the rest. The
        nearest action that keeps all linear preconditions is the first of the fallbacks. Where
        nothing legal is found, the proposal stands.
        """
        actions = dict(proposal)
        for name, (lower, upper) in self._box.items():
            if name in actions:
                actions[name] = _clipped(actions[name], lower, upper)
        for candidate in itertools.chain([actions], self._rounded(actions)):
            if self._is_legal(candidate):
                return Verdict(candidate, illegal=False, fallback=False)
        nearest = self._restored(actions)
        if nearest is not None:
            is_far = self._is_far(actions, nearest)
            return Verdict(nearest, illegal=is_far, fallback=is_far)
        for candidate in self._fallbacks(actions):
            if self._is_legal(candidate):
                return Verdict(candidate, illegal=True, fallback=True)
        if self._unmet is None:
            self._unmet = self._unmet_by(actions)
        return Verdict(actions, illegal=True, fallback=False, unmet=self._unmet)

    def _rounded(self, proposal: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
        """Its real actions a little nearer to the no-op's, or farther from them."""
        idle = self._idle[-1]
        given = {name: np.asarray(proposal[name]) for name in self._box if name in proposal}
        reals = {
            name: value
            for name, value in given.items()
            if value.dtype.kind == "f" and value.shape == np.shape(idle[name])
        }
        for share in _ROUNDING if reals else ():
            for factor in (1.0 - share, 1.0 + share):
                moved = {n: idle[n] + factor * (value - idle[n]) for n, value in reals.items()}
                kept = {name: _clipped(each, *self._box[name]) for name, each in moved.items()}
                yield {**proposal, **kept}

    def _restored(self, proposal: Mapping[str, Any]) -> dict[str, Any] | None:
        """The nearest action that keeps the linear preconditions, if it is legal."""
        if not self._linear.is_needed or not self._are_finite(proposal):
            return None
        try:
            prepared = self._env.sampler.prepare_actions_for_sim(proposal)
        except RDDLInvalidActionError:
            return None
        nearest = self._linear.restored(prepared)
        return nearest if self._is_legal(nearest) else None

    def _is_far(self, proposal: Mapping[str, Any], nearest: Mapping[str, Any]) -> bool:
        """Whether a real action has moved by more than rounding explains."""
        given = {n: np.asarray(proposal.get(n, self._idle[0][n]), float) for n in self._box}
        largest = max(float(np.max(np.abs(each), initial=0.0)) for each in given.values())
        most = LARGEST_ROUNDING * (1.0 + largest)
        return any(np.any(np.abs(given[name] - nearest[name]) > most) for name in given)

    def _are_finite(self, actions: Mapping[str, Any]) -> bool:
        reals = (actions[name] for name in self._box if name in actions)
        return all(np.all(np.isfinite(value)) for value in reals)

    def _fallbacks(self, proposal: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
        """The no-op; it with one bool changed; it with all bools of a fluent changed.

        A bool that the proposal changes comes before one that it leaves. Where defaults lie outside
        of their box, the same follows with the numbers of the box that are nearest to them.
        """
        for noop in self._idle:
            yield dict(noop)
            idle = {name: np.asarray(noop[name]) for name in self._bools}
            for is_changed in (True, False):
                for name, value in idle.items():
                    proposed = np.asarray(proposal.get(name, value))
                    differs = (proposed if proposed.shape == value.shape else value) != value
                    for place in map(tuple, np.argwhere(differs == is_changed)):
                        one = value.copy()
                        one[place] = ~one[place]
                        yield noop | {name: one if one.shape else one.item()}
            for name, value in idle.items():
                everywhere = ~value
                yield noop | {name: everywhere if value.shape else everywhere.item()}

    def _unmet_by(self, proposal: Mapping[str, Any]) -> tuple[str, ...]:
        """The preconditions that nothing keeps of what was tried, or else the proposal does not."""
        preconditions = self._env.model.preconditions
        broken = [self._broken_by(each) for each in (proposal, *self._fallbacks(proposal))]
        by_all = set.intersection(*broken) or broken[0]
        return tuple(precondition_text(preconditions[place]) for place in sorted(by_all))

    def _broken_by(self, actions: Mapping[str, Any]) -> set[int]:
        """Places of the preconditions that do not hold; all for what has another form."""
        sampler = self._env.sampler
        preconditions = list(enumerate(self._env.model.preconditions))
        try:
            sampler.subs.update(sampler.prepare_actions_for_sim(actions))
        except RDDLInvalidActionError:
            return {place for place, _ in preconditions}
        return {place for place, each in preconditions if not sampler._sample(each, sampler.subs)}

    def _is_legal(self, actions: Mapping[str, Any]) -> bool:
        # the environment takes what is not finite where there is no box
        if not self._are_finite(actions):
            return False
        sampler = self._env.sampler
        try:
            # refuses what has another form
            prepared = sampler.prepare_actions_for_sim(actions)
            sampler.check_default_action_count(prepared, self._env.enforce_count_non_bool)
        except RDDLInvalidActionError:
            return False
        return sampler.check_action_preconditions(prepared, silent=True)


def precondition_text(precondition: Any) -> str:
    """A precondition as RDDL, in one line."""
    return " ".join(RDDLDecompiler().decompile_expr(precondition).split())


def _clipped(value: Any, lower: Any, upper: Any) -> Any:
    """A real action in its box; what has another form, which the environment refuses, as it is."""
    try:
        return np.clip(np.asarray(value, np.float64), lower, upper)
    except (TypeError, ValueError):
        return value


def _nearest(default: Any, box: tuple[Any, Any], kind: str) -> Any:
    """The number in a box that is nearest to a default."""
    lower, upper = box if kind == "real" else (np.ceil(box[0]), np.floor(box[1]))
    nearest = np.clip(default, lower, upper).astype(np.asarray(default).dtype)
    return nearest if np.shape(default) else nearest.item()
