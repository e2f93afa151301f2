"""How large a configuration may make a planner, before anything of that size is made."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from mdpo_rddl.planner.config.budgets import JAXPLAN_BATCH
from mdpo_rddl.planner.config.values import is_number
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.sizes import MOST_STEPS, oversize

MOST_ROLLOUTS = 1_000_000
"""Side by side in one iteration; noise beside each parallel update doubles them."""

MOST_LAYERS = 100
MOST_UNITS = 65_536
"""Of one layer."""

MOST_PARAMETERS = 2**27
"""Of a policy's net; as many as a policy file of 512 MiB holds."""

MOST_ROLLOUT_FLUENTS = 1_000_000_000
"""Rollouts of one iteration times ground fluents of the state and the action."""

MOST_ROLLOUT_STEPS = 1_000_000_000
"""Rollouts of one iteration times steps."""

MOST_CALLS = 1_000_000
"""Iterations of one compiled call; returns of a rolling mean."""

MOST_BINS = 10_000
"""Of a relaxed distribution."""

_MOST = {
    "Planner": {
        "batch_size_train": MOST_ROLLOUTS,
        "batch_size_test": MOST_ROLLOUTS,
        "parallel_updates": MOST_ROLLOUTS,
        "rollout_horizon": MOST_STEPS,
    },
    "Compiler": {"binomial_nbins": MOST_BINS, "poisson_nbins": MOST_BINS},
    # JAX counts them in 32 bits
    "Optimize": {"test_rolling_window": MOST_CALLS, "epochs": 2**31 - 1},
    "Noise": {"analysis_samples": MOST_ROLLOUTS},
    "MDPO": {"iterations_per_call": MOST_CALLS, "test_every": MOST_CALLS},
}
# in the dictionaries of [Planner]: sizes of arrays, and turns of loops that nothing can end
_MOST_WITHIN = {
    "cosines": 1_000,
    "max_constraint_iter": 100_000,
    "max_linesearch_steps": 1_000,
    "memory_size": 1_000,
    "samples": 1_000,
}

Sections = Mapping[str, Mapping[str, Any]]


def out_of_bounds(sections: Sections) -> str | None:
    """What of a configuration is too large, or no size at all, in words; None if nothing is.

    Args:
      sections: per section, its keys and literal values; those that must be positive are.
    """
    for section, bounds in _MOST.items():
        for key, most in bounds.items():
            value = sections.get(section, {}).get(key) or 0
            if value > most:
                return f"[{section}] {key}: must be at most {most:,}, got {_short(value)}"
    return (
        _wrong_pgpe_batch(sections)
        or _wrong_topology(sections)
        or _wrong_within(sections)
        or _wrong_hyperparams(sections)
        or _wrong_fluent_bounds(sections)
        or _too_many_rollouts(sections)
    )


def too_large_for(problem: Problem, sections: Sections) -> str | None:
    """What of a configuration is too large for a problem, in words; None if nothing is.

    Args:
      problem: the parsed problem.
      sections: those of a configuration that is within the bounds of `out_of_bounds`.
    """
    model, values = problem.model, sections["Planner"]
    rollouts, names = _rollouts(sections)
    seen = model.observ_fluents or model.state_fluents
    inputs, outputs = _ground(model, seen), _ground(model, model.action_fluents)
    fluents = _ground(model, model.state_fluents) + outputs
    steps = values.get("rollout_horizon") or problem.horizon
    # the instance's own was looked at when it was read
    too_long = oversize(model.ast, steps) if steps > problem.horizon else None
    if too_long is not None:
        return f"[Planner] rollout_horizon: {too_long}"
    for what, size, most in (
        ("ground fluents", fluents, MOST_ROLLOUT_FLUENTS),
        ("steps", steps, MOST_ROLLOUT_STEPS),
    ):
        if rollouts * size > most:
            return (
                f"[Planner] {names}: {rollouts:,} rollouts of {size:,} {what}, "
                f"at most {most // size:,} can be planned with"
            )
    layers = (values.get("method_kwargs") or {}).get("topology")
    return _too_many_parameters([inputs, *layers, outputs]) if layers else None


def _wrong_pgpe_batch(sections: Sections) -> str | None:
    value = (sections["Planner"].get("pgpe_kwargs") or {}).get("batch_size", 1)
    if is_number(value, int) and 1 <= value <= MOST_ROLLOUTS:
        return None
    return (
        f"[Planner] pgpe_kwargs: batch_size must be an integer from 1 to {MOST_ROLLOUTS:,}, "
        f"got {_short(value)}"
    )


def _wrong_topology(sections: Sections) -> str | None:
    layers = (sections["Planner"].get("method_kwargs") or {}).get("topology")
    if layers is None:
        return None
    where = "[Planner] method_kwargs: topology"
    if not isinstance(layers, list | tuple):
        return f"{where} must be a list of integers, got {_short(layers)}"
    if len(layers) > MOST_LAYERS:
        return f"{where} must have at most {MOST_LAYERS} layers, got {len(layers):,}"
    for units in layers:
        if not (is_number(units, int) and 1 <= units <= MOST_UNITS):
            return (
                f"{where} must be integers from 1 to {MOST_UNITS:,}, units of a layer, "
                f"got {_short(units)}"
            )
    return _too_many_parameters(layers)


def _wrong_within(sections: Sections) -> str | None:
    for section, values in sections["Planner"].items():
        waiting = [values] if section.endswith("_kwargs") else []
        while waiting:
            value = waiting.pop()
            if not isinstance(value, Mapping):
                continue
            waiting += value.values()
            for key in value.keys() & _MOST_WITHIN.keys():
                most = _MOST_WITHIN[key]
                if not (is_number(value[key], int) and 0 <= value[key] <= most):
                    return (
                        f"[Planner] {section}: {key} must be an integer of at most {most:,}, "
                        f"got {_short(value[key])}"
                    )
    return None


def _too_many_parameters(layers: Sequence[int]) -> str | None:
    count = sum(before * after for before, after in pairwise(layers))
    if count <= MOST_PARAMETERS:
        return None
    return (
        f"[Planner] method_kwargs: topology makes {count:,} parameters, "
        f"at most {MOST_PARAMETERS:,} can be trained"
    )


def _wrong_hyperparams(sections: Sections) -> str | None:
    value = sections["Optimize"].get("policy_hyperparams")
    each = list(value.values()) if isinstance(value, dict) else [value]
    if value is None or all(is_number(number, int | float) for number in each):
        return None
    return (
        "[Optimize] policy_hyperparams: must be a number, or a dictionary of numbers by action, "
        f"got {_short(value)}"
    )


def _wrong_fluent_bounds(sections: Sections) -> str | None:
    value = (sections["Planner"].get("preprocessor_kwargs") or {}).get("fluent_bounds", {})
    if isinstance(value, dict) and all(map(_is_interval, value.values())):
        return None
    return (
        "[Planner] preprocessor_kwargs: fluent_bounds must be a dictionary of two numbers by "
        f"fluent, the lower one first, got {_short(value)}"
    )


def _is_interval(value: Any) -> bool:
    if not isinstance(value, list | tuple) or len(value) != 2:
        return False
    # in 32 bit
    integers = all(abs(each) < 2**31 for each in value if is_number(each, int))
    numbers = all(is_number(each, int | float) and abs(each) < 1e38 for each in value)
    return integers and numbers and value[0] < value[1]


def _too_many_rollouts(sections: Sections) -> str | None:
    rollouts, names = _rollouts(sections)
    if rollouts <= MOST_ROLLOUTS:
        return None
    return f"[Planner] {names}: together at most {MOST_ROLLOUTS:,} rollouts, got {rollouts:,}"


def _rollouts(sections: Sections) -> tuple[int, str]:
    """The most rollouts side by side in an iteration, and the keys that they come from."""
    values = sections["Planner"]
    train = {"batch_size_train": values.get("batch_size_train", JAXPLAN_BATCH)}
    tested = values.get("batch_size_test")
    test = {"batch_size_test": tested} if tested else train
    if values.get("pgpe", "") is not None:  # JaxPlan's default is one, and plays the test's batch
        batch = (values.get("pgpe_kwargs") or {}).get("batch_size", 1)
        test = {**test, "pgpe_kwargs batch_size": batch}
    samples = sections.get("Noise", {}).get("analysis_samples") or 1
    sizes = max(train, test, {"[Noise] analysis_samples": samples}, key=_product)
    sizes = {**sizes, "parallel_updates": values.get("parallel_updates") or 1}
    names = [name for name, size in sizes.items() if size > 1] or ["batch_size_train"]
    return _product(sizes), " times ".join(names)


def _product(sizes: Mapping[str, int]) -> int:
    return math.prod(sizes.values())


def _ground(model: Any, names: Any) -> int:
    """How many ground fluents some fluents have."""
    return sum(math.prod(model.object_counts(model.variable_params[name])) for name in names)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."
