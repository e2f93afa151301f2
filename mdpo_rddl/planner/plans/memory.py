"""What a policy remembers of an episode: means and traces of what it has seen and played.

A memory is a tree of arrays that a rollout carries from step to step, and a pure function that
brings it up to date with what was observed and played at a step. What it holds has the objects of
the fluent that it is about, so that a policy reads it as it reads a fluent.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

from mdpo_rddl.planner.plans.features import array_module

_MOST_STEPS = 100


@dataclass(frozen=True)
class MemoryShape:
    """What is remembered.

    A mean over N steps is exponential, m + (x - m) / N; over 1 step it is the last value. A trace
    is exp(-n / N), where a bool was last true n steps ago, and 0 before it ever was. Neither has
    the observation that the policy reads at the same step.

    Attributes:
      observations: the steps N of means of each observed fluent.
      actions: the same of each action fluent.
      observation_traces: the steps N of traces of each observed bool.
      action_traces: the same of each bool action.
    """

    observations: Sequence[float] = ()
    actions: Sequence[float] = ()
    observation_traces: Sequence[float] = ()
    action_traces: Sequence[float] = ()

    @classmethod
    def of(cls, values: Any) -> "MemoryShape":
        """What a configuration says.

        Args:
          values: the attributes by name; None for nothing.

        Raises:
          ValueError: if there are others, or an entry is no list of steps of at least 1, or of
            more than a hundred.
        """
        values = {} if values is None else values
        if not isinstance(values, Mapping):
            raise ValueError(f"memory: must be a dictionary, got {values!r}")
        known = [field.name for field in fields(cls)]
        for name, steps in values.items():
            if name not in known:
                raise ValueError(f"memory: unknown key {name!r}, known are {', '.join(known)}")
            if not isinstance(steps, list | tuple):
                raise ValueError(f"memory: {name} must be a list of steps, got {steps!r}")
            if len(steps) > _MOST_STEPS:
                raise ValueError(f"memory: {name} must be at most {_MOST_STEPS}, got {len(steps)}")
            for each in steps:
                if not isinstance(each, int | float) or not each >= 1:
                    raise ValueError(f"memory: {name} must be steps of at least 1, got {each!r}")
        return cls(**values)


class Mean(NamedTuple):
    """Exponential mean; all values have had the same weight as long as there are few."""

    source: str
    steps: float
    is_action: bool

    @property
    def is_scaled(self) -> bool:
        """Whether the policy reads it in the scale of its fluent; actions come in units."""
        return not self.is_action

    @property
    def name(self) -> str:
        """For diagnostics, and as the key of parameters."""
        if self.steps == 1.0:
            return f"last {self.source}"
        return f"mean of {self.source} over {self.steps:g} steps"

    def start(self, center: float) -> float:
        """Nothing is known yet."""
        return center

    def after(self, before: Any, value: Any, count: Any) -> Any:
        """The value joins with the weight 1/N, corrected for the start."""
        xp, share = array_module(before), 1.0 / self.steps
        weight = share / (1.0 - (1.0 - share) ** (xp.maximum(count, 0.0) + 1.0))
        return xp.where(count < 0.0, before, before + weight * (value - before))


class Trace(NamedTuple):
    """Falls with the steps since a bool was last true."""

    source: str
    steps: float
    is_action: bool

    @property
    def is_scaled(self) -> bool:
        """It is between 0 and 1 already."""
        return False

    @property
    def name(self) -> str:
        """For diagnostics, and as the key of parameters."""
        return f"trace of {self.source} over {self.steps:g} steps"

    def start(self, center: float) -> float:
        """It never was true."""
        del center
        return 0.0

    def after(self, before: Any, value: Any, count: Any) -> Any:
        """1 where it is true, else a little less than before."""
        xp = array_module(before)
        now = xp.where(count < 0.0, 0.0, value)
        return xp.maximum(now, math.exp(-1.0 / self.steps) * before)


class Memory:
    """The memory of a feedback policy.

    Attributes:
      entries: by name.
      types: of the parameters of each entry, by name.
    """

    def __init__(self, rddl: Any, observed: Sequence[str], shape: MemoryShape) -> None:
        """Finds what there is to remember.

        Args:
          rddl: pyRDDLGym's lifted model.
          observed: the fluents that a policy reads.
          shape: what is remembered of them, and of the actions.
        """
        # what a partially observed problem shows before the first step is no observation
        self._first = 1 if rddl.observ_fluents else 0
        bools = {name for name, kind in rddl.variable_ranges.items() if kind == "bool"}
        actions = list(rddl.action_fluents)
        entries: list[Mean | Trace] = []
        for sources, means, traces in (
            (observed, shape.observations, shape.observation_traces),
            (actions, shape.actions, shape.action_traces),
        ):
            is_action = sources is actions
            entries += [Mean(name, n, is_action) for name in sources for n in means]
            entries += [
                Trace(name, n, is_action) for name in sources if name in bools for n in traces
            ]
        self.entries = {entry.name: entry for entry in entries}
        params = rddl.variable_params
        self.types = {name: list(params[entry.source]) for name, entry in self.entries.items()}

    def updated(
        self, memory: Mapping[str, Any], step: Any, values: Mapping[str, Any]
    ) -> dict[str, Any]:
        """The memory after a step.

        Args:
          memory: before it, arrays of numpy's or JAX's.
          step: of the rollout, from 0.
          values: of the observed fluents, and of the actions in units from the no-op, each of the
            shape of its entries.
        """
        found = {}
        for name, entry in self.entries.items():
            before = memory[name]
            xp = array_module(before)
            value = xp.reshape(xp.asarray(values[entry.source], before.dtype), before.shape)
            count = step - (0 if entry.is_action else self._first)
            found[name] = entry.after(before, value, xp.asarray(count, before.dtype))
        return found
