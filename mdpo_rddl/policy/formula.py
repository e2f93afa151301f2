"""stand-in until helper A's"""
import numpy as np
from mdpo_rddl.planner.plans.feedback import Feedback
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.planner.plans.feedback_actions import FeedbackActions
from mdpo_rddl.policy.side_by_side import FormulaReplicas
from mdpo_rddl.problem.boxes import action_boxes
from mdpo_rddl.problem.limits import GroupLimit, group_limits


def box_width(lower, upper):
    width = np.subtract(upper, lower, dtype=float)
    finite = width[np.isfinite(width) & (width > 0)]
    return float(np.median(finite)) if finite.size else None


class FeedbackFormula:
    def __init__(self, problem, config, simulator):
        model = problem.model
        arguments = dict(config.policy_arguments)
        units = arguments.pop("units", {})
        shape = FeedbackShape(**arguments)
        feedback = Feedback(model, simulator.values, shape, problem.horizon, np.float32)
        ranges = model.variable_ranges
        boxes = action_boxes(model)
        bools = [n for n in feedback.action_shapes if ranges[n] == "bool"]
        numbers = [n for n in feedback.action_shapes if ranges[n] != "bool"]
        un = {}
        for n in numbers:
            s = feedback.action_shapes[n]
            if n in units: un[n] = np.full(s, units[n])
            elif ranges[n] in model.type_to_objects: un[n] = np.full(s, max(1.0, len(model.type_to_objects[ranges[n]]) - 1.0))
            else: un[n] = np.full(s, box_width(*boxes[n]) or 1.0)
        for n in numbers:
            if ranges[n] in model.type_to_objects:
                boxes[n] = (np.zeros(feedback.action_shapes[n]), np.full(feedback.action_shapes[n], len(model.type_to_objects[ranges[n]]) - 1.0))
        noop = {n: np.asarray(simulator.values[n]) > .5 for n in bools} | {n: np.asarray(simulator.values[n]) for n in numbers}
        count = sum(np.size(noop[n]) for n in bools)
        limits = []
        if bools and model.max_allowed_actions < count:
            limits = [GroupLimit({n: np.zeros(feedback.action_shapes[n], int) for n in bools}, np.array([model.max_allowed_actions]))]
        self.actions = FeedbackActions(feedback.on_numpy(), noop, un, boxes, [n for n in numbers if ranges[n] != "real"], (np.float32, np.int32), limits)
        self.groups = group_limits(model)[0]
    def replicas(self, params):
        return FormulaReplicas(self.actions, params, self.groups)
