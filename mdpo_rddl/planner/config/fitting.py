"""The preset's configuration, fitted to a problem."""

from typing import Any

import numpy as np

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.problem.load import Problem

MEMORY = {"observations": [4.0], "actions": [1.0]}
"""What is remembered where the state is not observed, as a `MemoryShape` takes it."""


def without_scales(config: PlannerConfig) -> PlannerConfig:
    """The configuration for probing: no net, states as they are, units of 1 without a box."""
    return simplified(config)


def simplified(config: PlannerConfig) -> PlannerConfig:
    """The configuration for a problem of many objects: no net, and few features."""
    features = {"cosines": 0, "squares": False, "distant": False}
    return without_plan(config.with_policy_arguments(topology=[], lifted=0, pairs=0, **features))


def without_plan(config: PlannerConfig) -> PlannerConfig:
    """The configuration without an open-loop plan, for which noise needs an analysis of its own."""
    config = config.with_policy_arguments(plan=False)
    if "analysis_samples" not in config.noise_numbers:
        return config
    return config.with_values("Noise", analysis_samples=1)


def scaled(config: PlannerConfig, probe: Any) -> PlannerConfig:
    """The configuration with the scales that probing found, and with what is looked up.

    Args:
      config: with a `FeedbackPlan`.
      probe: has `units`, `state_scales` and `lookup_scales`.
    """
    lookups = config.policy_arguments.get("lookups", list(probe.lookup_scales))
    looked_up = {name: pair for name, pair in probe.lookup_scales.items() if name in lookups}
    # a centre is as exact as its scale makes a difference
    scales = {
        name: [float(np.round(center / scale, 3) * _short(scale)), _short(scale)]
        for name, (center, scale) in {**probe.state_scales, **looked_up}.items()
    }
    units = {name: _short(value) for name, value in probe.units.items()}
    config = config.with_policy_arguments(state_scales=scales, units=units)
    return config.with_policy_arguments(lookups=lookups) if lookups else config


def with_single_rollouts(config: PlannerConfig) -> PlannerConfig:
    """The configuration for a problem without chance: one rollout shows what a policy returns."""
    return config.with_values("Planner", batch_size_train=1, batch_size_test=1)


def without_pairs(config: PlannerConfig) -> PlannerConfig:
    """The configuration without gains of pairs of objects: without chance a plan does as well."""
    return config.with_policy_arguments(pairs=0)


def with_memory(config: PlannerConfig, problem: Problem) -> PlannerConfig:
    """The configuration with a memory, where the state is not observed and none is given."""
    if not problem.model.observ_fluents or "memory" in config.policy_arguments:
        return config
    return config.with_policy_arguments(memory=dict(MEMORY))


def greedy(config: PlannerConfig) -> PlannerConfig:
    """The configuration of the greedy policy of a value, which reads numbers in the same units."""
    arguments = config.policy_arguments
    lookups = arguments.get("lookups", ())
    scales = {n: s for n, s in arguments.get("state_scales", {}).items() if n not in lookups}
    plan = {"method": "GreedyPlan", "method_kwargs": {"state_scales": scales}}
    return config.with_values("Planner", **plan).without_noise()


def _short(value: float) -> float:
    """Four digits are enough for a scale that people may read."""
    return float(f"{value:.4g}")
