"""The terms of a feedback policy's rule, in the names and units of the domain."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mdpo_rddl.planner.plans.feedback import GAIN, PAIRS, Feedback, Params
from mdpo_rddl.planner.plans.feedback_actions import FeedbackActions

_DIGITS = 4


@dataclass(frozen=True, eq=False)
class Term:
    """A part of the rule of one action fluent.

    Attributes:
      action: the fluent.
      text: the term as it stands in the equation, with its sign; in words if it is no product.
      is_shared: whether it is one weight for all objects.
      params: of the policy without the term.
    """

    action: str
    text: str
    is_shared: bool
    params: Params


def terms_of(actions: FeedbackActions, params: Params) -> list[Term]:
    """The terms that are not zero.

    Args:
      actions: of the policy.
      params: of one policy.
    """
    found, feedback = [], actions.feedback
    for action in feedback.action_shapes:
        unit = raw_unit(actions, action)
        found += _shared_terms(feedback, params, action, unit)
        found += _own_terms(feedback, params, action, unit)
    return found


def raw_unit(actions: FeedbackActions, action: str) -> float:
    """What a raw value of 1 means: in the action's unit; 1 for a bool, whose score it is."""
    return float(np.max(actions.units[action])) if action in actions.units else 1.0


def _shared_terms(feedback: Feedback, params: Params, action: str, unit: float) -> list[Term]:
    if "shared" not in params:
        return []
    weights = np.asarray(params["shared"][action])
    texts = _texts(feedback, action)
    terms = []
    for place in np.flatnonzero(weights):
        factor, variable = texts[place]
        without = np.where(np.arange(len(weights)) == place, 0, weights).astype(weights.dtype)
        text = _product(unit * float(weights[place]) * factor, variable)
        terms.append(Term(action, text, True, _with(params, "shared", {action: without})))
    return terms


def _own_terms(feedback: Feedback, params: Params, action: str, unit: float) -> list[Term]:
    terms = []
    for name, values in params["own"][action].items():
        if not np.any(values):
            continue
        scale = 1.0
        text = "a constant of each object's own"
        if name != "bias":
            fluent = name.removeprefix(GAIN).removeprefix(PAIRS)
            center, scale = feedback.scale(fluent)
            whose = "of each object's own" if name.startswith(GAIN) else "for each pair of objects"
            text = f"a gain {whose} on {_centred(fluent, center)}"
        low, high = unit * np.min(values) / scale, unit * np.max(values) / scale
        text = f"+ {text} (from {_number(low)} to {_number(high)})"
        own = {**params["own"][action], name: np.zeros_like(values)}
        terms.append(Term(action, text, False, _with(params, "own", {action: own})))
    lifted = params.get("lifted", {}).get(action, {})
    if np.any(lifted.get("output", 0.0)):
        text = "+ a net that sees the features of each object, the same for all objects"
        silent = {action: {**lifted, "output": np.zeros_like(lifted["output"])}}
        terms.append(Term(action, text, True, _with(params, "lifted", silent)))
    if np.any(params.get("plan", {}).get(action, 0.0)):
        text = "+ an open-loop plan, a value for each step and object"
        without = {action: np.zeros_like(params["plan"][action])}
        terms.append(Term(action, text, False, _with(params, "plan", without)))
    output = f"output_{action}"
    if np.any(params.get("net", {}).get(output, 0.0)):
        text = "+ a net that sees the whole state"
        without = {output: np.zeros_like(params["net"][output])}
        terms.append(Term(action, text, False, _with(params, "net", without)))
    return terms


def _with(params: Params, part: str, changed: Mapping[str, Any]) -> Params:
    return {**params, part: {**params[part], **changed}}


def _texts(feedback: Feedback, action: str) -> list[tuple[float, str]]:
    """Per shared feature the factor from weight to coefficient, and what that multiplies."""
    features, names = feedback.features[action], feedback.names(action)
    scaled = {}
    for feature in features.state:
        center, scale = feedback.scale(feature.fluent)
        text = _centred(feature.name, center)
        scaled[feature.name] = (1.0 / scale, text)
        squared = text if text.startswith("(") else f"({text})"
        scaled[f"{feature.name}^2"] = (1.0 / scale**2, f"({squared}^2 - {_number(scale**2)})")
    constants = {}
    for name in features.constant:
        mean, deviation = features.moments[name]
        constants[name] = (1.0 / deviation, _centred(name, mean))
    return [{**scaled, **constants}.get(name, (1.0, name)) for name in names]


def _centred(name: str, center: float) -> str:
    if center == 0.0:
        return name
    return f"({name} {'-' if center > 0 else '+'} {_number(abs(center))})"


def _product(factor: float, variable: str) -> str:
    sign = "-" if factor < 0 else "+"
    return f"{sign} {_number(abs(factor))}" + ("" if variable == "1" else f" {variable}")


def _number(value: float) -> str:
    return f"{value:.{_DIGITS}g}"
