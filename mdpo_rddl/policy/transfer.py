"""A lifted rule on another instance of its domain: the shared weights fit any number of objects."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from mdpo_rddl.planner.plans.feedback import GAIN, PAIRS, Feedback, Params
from mdpo_rddl.policy.trees import flatten

_ONE = "1"


class Plan(Protocol):
    """What a transfer must know of a feedback policy."""

    @property
    def feedback(self) -> Feedback:
        """The raw actions."""

    @property
    def units(self) -> Mapping[str, Any]:
        """Per real or integer action fluent what a raw value of 1 means [*shape]."""


class Transfer(NamedTuple):
    """What was carried over.

    Attributes:
      params: of the other plan.
      left_out: what did not fit, in words.
    """

    params: Params
    left_out: tuple[str, ...]


class _Side(NamedTuple):
    """A plan and one of its action fluents."""

    plan: Plan
    feedback: Feedback
    action: str

    @property
    def unit(self) -> float:
        """What a raw value of 1 means."""
        return (
            float(np.max(self.plan.units[self.action])) if self.action in self.plan.units else 1.0
        )

    def scale(self, fluent: str) -> tuple[float, float]:
        """Centre and scale in which the policy reads a fluent; of a remembered action its unit."""
        action = self.feedback.remembered_action(fluent)
        if action is None or action not in self.plan.units:
            return self.feedback.scale(fluent)
        return 0.0, float(np.max(self.plan.units[action]))

    @property
    def fluents(self) -> dict[str, str]:
        """By the name of a feature of the state the fluent that it reads."""
        return {f.name: f.fluent for f in self.feedback.features[self.action].state}


def transferred(
    source: Plan, params: Params, target: Plan, base: Params, is_same: bool
) -> Transfer:
    """Parameters of another plan that play the same rule, as far as that can be.

    Shared weights are converted to the other plan's units and scales. What each object has of its
    own is carried over where the problem is the same, with the open-loop plan and the net;
    elsewhere its mean over the objects joins the shared weights. The hidden layer on each object's
    features is shared, too.

    Args:
      source: the plan that the rule was found with.
      params: of the rule.
      target: the plan of the other problem, of the same domain.
      base: parameters of the other plan that play the no-op.
      is_same: whether the problem is the same.
    """
    old, new = source.feedback, target.feedback
    result, left_out = dict(base), list[str]()
    for action in old.action_shapes:
        if action not in new.action_shapes:
            left_out.append(f"the action {action}")
            continue
        here, there = _Side(source, old, action), _Side(target, new, action)
        weights, lost = _shared(here, there, _averaged(here, params, is_same))
        left_out += [f"{action}: {name}" for name in lost]
        if not is_same and any(np.any(leaf) for leaf in params["own"][action].values()):
            left_out.append(f"{action}: what each object has of its own, but for its mean")
        dtype = base["shared"][action].dtype
        vector = [weights.get(name, 0.0) for name in new.names(action)]
        result["shared"] = {**result["shared"], action: np.asarray(vector, dtype)}
        if is_same:
            own = _own(here, there, params, base)
            known = params["own"][action]
            unfit = [name for name in known if name not in own and np.any(known[name])]
            left_out += [f"{action}: {name}, each object's own" for name in unfit]
            result["own"] = {**result["own"], action: own}
        layer, lost = _lifted(here, there, params, base)
        left_out += [f"{action}: {name}" for name in lost]
        if layer is not None:
            result["lifted"] = {**result["lifted"], action: layer}
    for part, name in (("plan", "the open-loop plan"), ("net", "the net")):
        if not any(np.any(leaf) for leaf in _outputs(params, part)):
            continue
        carried = _part(part, source, target, params, base) if is_same else None
        if carried is None:
            left_out.append(name)
        else:
            result[part] = carried
    return Transfer(result, tuple(left_out))


def _averaged(here: _Side, params: Params, is_same: bool) -> dict[str, float]:
    """Shared weights by name, with the mean of what is each object's own in another problem."""
    names = here.feedback.names(here.action)
    weights = dict(zip(names, np.asarray(params["shared"][here.action], float), strict=True))
    if is_same:
        return weights
    for name, values in params["own"][here.action].items():
        feature = name.removeprefix(GAIN) if name != "bias" else _ONE
        # neither a fluent at each of several arguments nor one of other objects is a feature
        if feature in weights:
            weights[feature] += float(np.mean(values))
    return weights


def _shared(
    here: _Side, there: _Side, weights: Mapping[str, float]
) -> tuple[dict[str, float], list[str]]:
    """The weights in the other plan's units and scales, and the names of those that do not fit."""
    names = set(there.feedback.names(there.action))
    found, lost = dict.fromkeys(names, 0.0), list[str]()
    ratio = here.unit / there.unit
    for name, weight in weights.items():
        if weight == 0.0:
            continue
        terms = _converted(here, there, name)
        if terms is None or not set(terms) <= names:
            lost.append(name)
            continue
        for other, factor in terms.items():
            found[other] += ratio * weight * factor
    return found, lost


def _lifted(
    here: _Side, there: _Side, params: Params, base: Params
) -> tuple[dict[str, Any] | None, list[str]]:
    """The hidden layer in the other plan's units and scales, and the names of what does not fit.

    A layer that says nothing, or of which the other plan has no like, is None.
    """
    layer = params.get("lifted", {}).get(here.action, {})
    if not np.any(layer.get("output", 0.0)):
        return None, []
    like = base.get("lifted", {}).get(there.action, {})
    if np.shape(like.get("output")) != np.shape(layer["output"]):
        return None, ["the hidden layer on each object's features"]
    places = {name: place for place, name in enumerate(there.feedback.names(there.action))}
    hidden, lost = np.zeros(np.shape(like["hidden"])), list[str]()
    rows = np.asarray(layer["hidden"], float)
    for name, row in zip(here.feedback.names(here.action), rows, strict=True):
        terms = _converted(here, there, name)
        if terms is None or not set(terms) <= set(places):
            lost.append(f"{name} in the hidden layer")
            continue
        for other, factor in terms.items():
            hidden[places[other]] += factor * row
    output = (here.unit / there.unit) * np.asarray(layer["output"], float)
    dtype = like["hidden"].dtype
    return {"hidden": np.asarray(hidden, dtype), "output": np.asarray(output, dtype)}, lost


def _converted(here: _Side, there: _Side, name: str) -> dict[str, float] | None:
    """A feature as a combination of the other plan's: z = r z' + d, so z^2 - 1 has three terms."""
    base = name.removesuffix("^2")
    if base in here.fluents:
        if base not in there.fluents:
            return None
        fluent = here.fluents[base]
        stretch, shift = _change(here.scale(fluent), there.scale(fluent))
        if base == name:
            return {base: stretch, _ONE: shift}
        square = {name: stretch**2, _ONE: shift**2 + stretch**2 - 1.0}
        return square | ({base: 2.0 * stretch * shift} if shift else {})
    moments = here.feedback.features[here.action].moments
    if name in moments:
        others = there.feedback.features[there.action]
        if name not in others.moments:
            return None
        stretch, shift = _change(moments[name], others.moments[name])
        return {_ONE: shift} | ({name: stretch} if name in others.constant else {})
    return {name: 1.0}


def _change(old: tuple[float, float], new: tuple[float, float]) -> tuple[float, float]:
    """r and d of (x - c) / s = r (x - c') / s' + d, of centres c and scales s."""
    return new[1] / old[1], (new[0] - old[0]) / old[1]


def _own(here: _Side, there: _Side, params: Params, base: Params) -> dict[str, Any]:
    """Each object's own weights, where the objects are the same."""
    ratio, own = here.unit / there.unit, dict(base["own"][there.action])
    bias = np.array(params["own"][here.action]["bias"], float)
    for name, values in params["own"][here.action].items():
        if name == "bias" or name not in own:  # of a memory that the other plan lacks
            continue
        fluent = name.removeprefix(GAIN).removeprefix(PAIRS)
        stretch, shift = _change(here.scale(fluent), there.scale(fluent))
        own[name] = np.asarray(ratio * stretch * np.asarray(values), own[name].dtype)
        each = tuple(range(bias.ndim, np.ndim(values)))
        bias += shift * np.sum(np.asarray(values, float), axis=each)
    own["bias"] = np.asarray(ratio * bias, own["bias"].dtype)
    return own


def _outputs(params: Params, part: str) -> list[Any]:
    """What must not be zero for a part to say anything."""
    entries = params.get(part, {})
    return [leaf for name, leaf in entries.items() if part == "plan" or name.startswith("output_")]


def _part(part: str, source: Plan, target: Plan, params: Params, base: Params) -> Any | None:
    """The open-loop plan, or the net, of the same problem; None if it does not fit."""
    trees = [flatten(each.get(part, {}), part) for each in (params, base)]
    shapes = [{name: leaf.shape for name, leaf in tree.items()} for tree in trees]
    if shapes[0] != shapes[1]:
        return None
    old, new = source.feedback, target.feedback
    one, other = _Side(source, old, ""), _Side(target, new, "")
    if part == "net" and (
        old.fluents != new.fluents
        or any(one.scale(name) != other.scale(name) for name in old.fluents)
    ):
        return None
    carried = {}
    for name, entry in params[part].items():
        # the net's hidden layers are as they were
        action = name.removeprefix("output_")
        is_output = action in old.action_shapes
        sides = [_Side(plan, plan.feedback, action) for plan in (source, target) if is_output]
        ratio = sides[0].unit / sides[1].unit if sides else 1.0
        carried[name] = _times(entry, ratio)
    return carried


def _times(tree: Any, ratio: float) -> Any:
    """A tree of arrays, each of them multiplied."""
    if isinstance(tree, Mapping):
        return {name: _times(each, ratio) for name, each in tree.items()}
    return (ratio * np.asarray(tree)).astype(np.asarray(tree).dtype)
