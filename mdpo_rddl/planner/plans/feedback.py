"""A policy of lifted linear feedback, one loop per object, a net and a plan, as a pure function."""

import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from mdpo_rddl.planner.plans.feature_values import feature_values, weighted_sum
from mdpo_rddl.planner.plans.features import ActionFeatures, action_features, observed_fluents
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.planner.plans.lookups import Lookups
from mdpo_rddl.planner.plans.memory import Memory, MemoryShape

if TYPE_CHECKING:  # who plays on numpy need not import it
    from jax import Array

_LARGEST_INPUT = 10.0
_LARGEST_NET_INPUT = 5.0
# of a fluent: so few are multiplied in less time than a product of matrices takes to begin
_FEW_PAIRS = 256
# folded into the key of the hidden layer on each object's features; no part of a split
_LIFTED = 2**30
GAIN, PAIRS = "gain on ", "gains of pairs on "
"""How the entries of `own` begin that are gains on a fluent: of the same objects, and of each."""
OUTPUT = "output_"
"""How the net's last layers begin, one for each action fluent."""

Params = dict[str, Any]


class Feedback:
    """The raw, unit-free action of each object as a function of the state.

    In units in which states are of order 1, that of object x is

        u_a(x) = w_a . phi_a(s, t, x) + v_a . tanh(phi_a(s, t, x) V_a)
                 + b_a(x) + sum_f k_af(x) f(x) + sum_fy K_af(x, y) f(y) + p_a(t, x)
                 + net_a(s)(x),

    phi being the features of `features`, their squares and cosines of the time; w, v and V are
    shared by all objects, b and k are each object's own, K is that of each pair of objects, p is an
    open-loop plan, the net sees the whole state.

    A memory's entries are read as fluents are, and so are fluents at objects that the state names.

    The formula stands once, for JAX and for numpy: `on_numpy` computes it with numpy, for many
    replicas of the state at once, which are the last axis of all arrays but the parameters.

    The parameters are {"shared": {action: [features]}, "own": {action: {"bias": [*shape],
    "gain on " + fluent: [*shape], "gains of pairs on " + fluent: [*shape, *fluent's shape]}},
    "lifted": {action: {"hidden": [features, units], "output": [units]}}, "plan": {action: [H,
    *shape]}, "net": {...}}, the last three only if there are such units, a plan or a net, and
    gains of pairs only of actions that are numbers, and if there are few pairs. Parts that are left
    out, other than the biases, count as zero, and nothing is computed for them.

    Attributes:
      observed: the observed fluents.
      seen: what the policy is given: these, then the entries of its memory.
      fluents: all that it reads: these, and what is looked up by them.
      shapes: of each of them.
      action_shapes: of each action fluent.
      features: of each action fluent.
      xp: the module that computes, jax.numpy or numpy.
      is_replicated: whether arrays have a last axis of replicas.
    """

    def __init__(
        self,
        rddl: Any,
        values: Mapping[str, Any],
        shape: FeedbackShape,
        horizon: int,
        dtype: Any,
        xp: Any = np,
    ) -> None:
        """Finds the features.

        Args:
          rddl: pyRDDLGym's lifted model.
          values: per fluent and non-fluent, an array of its shape.
          shape: what the policy is made of.
          horizon: number of steps H.
          dtype: floating type of the model.
          xp: the module that computes: jax.numpy, or numpy, for replicas.

        Raises:
          ValueError: for a name of what is looked up that is none.
        """
        self.xp, self.is_replicated = xp, xp is np
        self.shape, self.horizon, self.dtype = shape, horizon, dtype
        self._scales = dict(shape.state_scales or {})
        observed = self.observed = observed_fluents(rddl)
        self._lookups = Lookups(rddl, values, shape.lookups)
        self._memory = Memory(rddl, observed, MemoryShape.of(shape.memory))
        self.seen = [*observed, *self._memory.entries]
        types = self._memory.types | self._lookups.types
        self.fluents = [*observed, *types]
        self.action_shapes = {name: tuple(np.shape(values[name])) for name in rddl.action_fluents}
        self.features: dict[str, ActionFeatures] = {}
        self._own: dict[str, list[str]] = {}
        params = {**rddl.variable_params, **types}
        for name in self.action_shapes:
            found = action_features(rddl, values, name, shape.distant, types)
            self.features[name] = found
            self._own[name] = [f for f in self.fluents if params[f] == params[name]]
        sources = {name: entry.source for name, entry in self._memory.entries.items()}
        self.shapes = {f: tuple(np.shape(values[sources.get(f, f)])) for f in self.seen}
        self.shapes |= self._lookups.shapes
        self._inputs = sum(math.prod(shape) for shape in self.shapes.values())
        ranges = rddl.variable_ranges
        self._pairs = {
            name: self._paired(name) if ranges[name] in ("real", "int") else []
            for name in self.action_shapes
        }

    def on_numpy(self) -> "Feedback":
        """The same formula on numpy, for replicas of the state."""
        other = copy(self)
        other.xp, other.is_replicated = np, True
        return other

    def _paired(self, action: str) -> list[str]:
        """The fluents of whose pairs there are gains: where neither has objects, `own` says all."""
        shape = self.action_shapes[action]
        inputs = sum(math.prod(self.shapes[fluent]) for fluent in self.seen)
        if math.prod(shape) * inputs > self.shape.pairs:
            return []
        return [fluent for fluent in self.seen if shape or self.shapes[fluent]]

    def names(self, action: str) -> list[str]:
        """Names of an action fluent's shared features, in the order of its weights."""
        found = self.features[action]
        names = [feature.name for feature in found.state]
        squares = [f"{name}^2" for name in names] if self.shape.squares else []
        cosines = [f"cos({k} pi t / H)" for k in range(1, self.shape.cosines + 1)]
        return ["1", *names, *squares, *found.constant, *cosines]

    def initial(self, key: "Array | np.random.Generator") -> Params:
        """Parameters with which every raw action is zero.

        Args:
          key: draws the hidden units; with a generator of numpy's nothing is compiled for that.
        """
        zeros = np.zeros if isinstance(key, np.random.Generator) else self.xp.zeros
        lifted_normal, net_normal = _normals(key, self.dtype)
        own = {
            name: {
                "bias": zeros(shape, self.dtype),
                **{f"{GAIN}{f}": zeros(shape, self.dtype) for f in self._own[name]},
                **{
                    f"{PAIRS}{f}": zeros(shape + self.shapes[f], self.dtype)
                    for f in self._pairs[name]
                },
            }
            for name, shape in self.action_shapes.items()
        }
        shared = {name: zeros(len(self.names(name)), self.dtype) for name in own}
        plan = {
            name: zeros((self.horizon, *shape), self.dtype)
            for name, shape in (self.action_shapes.items() if self.shape.plan else ())
        }
        lifted = {}
        for number, name in enumerate(own if self.shape.lifted else ()):
            count, units = len(self.names(name)), self.shape.lifted
            hidden = lifted_normal(number, (count, units))
            output = zeros(units, self.dtype)
            lifted[name] = {"hidden": hidden / math.sqrt(count), "output": output}
        net: dict[str, Any] = {}
        width = self._inputs
        for number, size in enumerate(self.shape.layers if self._inputs else ()):
            kernel = net_normal((width, size)) / math.sqrt(width)
            net[f"hidden_{number}"] = {"kernel": kernel, "bias": zeros(size, self.dtype)}
            width = size
        if net:
            for name, shape in self.action_shapes.items():
                net[f"{OUTPUT}{name}"] = zeros((width, math.prod(shape)), self.dtype)
        parts = {"lifted": lifted, "plan": plan, "net": net}
        return {
            "shared": shared,
            "own": own,
            **{name: part for name, part in parts.items() if part},
        }

    def scale(self, fluent: str) -> tuple[float, float]:
        """Centre and scale in which the policy reads a fluent, or an entry of its memory."""
        if fluent in self._memory.entries:
            entry = self._memory.entries[fluent]
            return self.scale(entry.source) if entry.is_scaled else (0.0, 1.0)
        center, scale = self._scales.get(fluent, (0.0, 1.0))
        return float(center), float(scale)

    def remembered_action(self, name: str) -> str | None:
        """The action fluent that an entry of the memory is about; None for whatever else."""
        entry = self._memory.entries.get(name)
        return entry.source if entry is not None and entry.is_action else None

    def empty_memory(self) -> dict[str, Any]:
        """The memory before the first step, per entry [*shape], without replicas."""
        return {
            name: self.xp.full(self.shapes[name], entry.start(self.scale(name)[0]), self.dtype)
            for name, entry in self._memory.entries.items()
        }

    def updated(
        self, memory: Mapping[str, Any], step: Any, values: Mapping[str, Any]
    ) -> dict[str, Any]:
        """The memory after a step.

        Args:
          memory: before it.
          step: of the rollout, from 0.
          values: of the observed fluents, and of the actions in units from the no-op [*shape].
        """
        return self._memory.updated(memory, step, values)

    def raw(self, params: Params, state: Mapping[str, Any], step: Any) -> dict[str, Any]:
        """The raw actions, per fluent [*shape].

        Of replicas [*shape, B], or [*shape, 1] where a policy plays the same in all of them.

        Args:
          params: as `initial` makes them; of replicas that each have a policy of their own the
            shared weights, own weights and plans may have a last axis B.
          state: per observed fluent its value [*shape], of replicas [*shape, B], and the entries
            of the memory.
          step: of the rollout, from 0.
        """
        scaled = self._all_scaled(state)
        hidden = self._hidden(params.get("net", {}), scaled)
        time = step / self.horizon
        actions = {}
        for name, shape in self.action_shapes.items():
            own = params["own"][name]
            value = self.of_all(own["bias"], name)
            if name in params.get("shared", {}):
                columns = self._columns(name, scaled, time)
                value = value + weighted_sum(params["shared"][name], columns)
            for fluent in self._own[name]:
                if (gain := f"{GAIN}{fluent}") in own:
                    value = value + self.of_all(own[gain], name) * scaled[fluent]
            for fluent in self._pairs[name]:
                if (gains := f"{PAIRS}{fluent}") in own:
                    value = value + self._product(own[gains], scaled[fluent], len(shape))
            if "lifted" in params:
                value = value + self._lifted(name, params["lifted"][name], scaled, time)
            if "plan" in params:
                # JAX takes the last step's for what comes after it
                place = min(step, self.horizon - 1) if self.is_replicated else step
                value = value + self.of_all(params["plan"][name][place], name)
            if hidden is not None:
                output = (hidden @ params["net"][f"{OUTPUT}{name}"]).T
                value = value + self.xp.reshape(output, shape + output.shape[1:])
            actions[name] = value
        return actions

    def of_all(self, value: Any, name: str) -> Any:
        """What an action fluent has in all replicas [*shape], so that it broadcasts to theirs.

        What each replica has of its own [*shape, B] stays as it is.
        """
        if not self.is_replicated:
            return value
        return np.reshape(value, (*self.action_shapes[name], -1))

    def flat(self, state: Mapping[str, Any]) -> Any:
        """All that the policy reads, in the units in which it does, side by side [..., inputs]."""
        return self._side_by_side(self._all_scaled(state))

    def _side_by_side(self, scaled: Mapping[str, Any]) -> Any:
        rows = [(math.prod(self.shapes[name]), *self._replicas(scaled)) for name in self.fluents]
        parts = zip(self.fluents, rows, strict=True)
        return self.xp.concatenate([self.xp.reshape(scaled[n], shape) for n, shape in parts]).T

    def _replicas(self, values: Mapping[str, Any]) -> tuple[int, ...]:
        """How many replicas there are, (B,); () if they are no axis."""
        if not self.is_replicated:
            return ()
        return next((value.shape[-1:] for value in values.values()), (1,))

    def _all_scaled(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """All that the policy reads, in the units in which it does, per fluent [*shape]."""
        given = {name: self.xp.asarray(state[name]) for name in self.seen}
        replicas = self._replicas(given)
        read = {**given, **self._lookups(given, replicas)}
        return {name: self._scaled(name, read[name], replicas) for name in self.fluents}

    def _scaled(self, name: str, value: Any, replicas: tuple[int, ...]) -> Any:
        xp, (center, scale) = self.xp, self.scale(name)
        # the environment gives a fluent without parameters as an array of one
        value = xp.reshape(xp.asarray(value, self.dtype), self.shapes[name] + replicas)
        scaled = (value - center) / scale
        if self.shape.cut_feedback and xp is not np:
            from jax import lax

            scaled = lax.stop_gradient(scaled)
        return xp.clip(scaled, -_LARGEST_INPUT, _LARGEST_INPUT)

    def _lifted(
        self, name: str, weights: Mapping[str, Any], scaled: Mapping[str, Any], time: Any
    ) -> Any:
        """v_a . tanh(phi_a V_a), an array that broadcasts to the action's shape."""
        xp, hidden = self.xp, weights["hidden"]
        columns = self._columns(name, scaled, time)
        parts = [
            xp.tensordot(xp.stack([columns[n] for n in numbers], axis=-1), hidden[numbers], 1)
            for numbers in self._groups(name, columns)
        ]
        return xp.tanh(sum(parts[1:], start=parts[0])) @ weights["output"]

    def _groups(self, name: str, columns: Sequence[Any]) -> list[np.ndarray]:
        """The numbers of features that depend on the same axes; of others one by one."""
        groups: dict[tuple[int, ...], list[int]] = {}
        fixed = len(columns) - len(self.features[name].constant) - self.shape.cosines
        for number, column in enumerate(columns[:fixed]):
            groups.setdefault(np.shape(column), []).append(number)
        places = [*groups.values(), *([number] for number in range(fixed, len(columns)))]
        return [np.array(numbers) for numbers in places]

    def _columns(self, name: str, scaled: Mapping[str, Any], time: Any) -> list[Any]:
        """phi_a, the features in the order of their weights, each as `feature_values` gives it."""
        xp, shape, found = self.xp, self.action_shapes[name], self.features[name]
        replicas = self._replicas(scaled)
        seen = feature_values(found.state, scaled, replicas)
        one = xp.ones((1,) * (len(shape) + len(replicas)), self.dtype)
        columns = [one, *seen]
        if self.shape.squares:
            columns += [value**2 - 1.0 for value in seen]
        for value in found.constant.values():
            columns.append(self.of_all(xp.asarray(value, self.dtype), name))
        angle = xp.pi * xp.asarray(time, self.dtype)
        return columns + [one * xp.cos(k * angle) for k in range(1, self.shape.cosines + 1)]

    def _hidden(self, net: Mapping[str, Any], scaled: Mapping[str, Any]) -> Any:
        if not net:
            return None
        hidden = self._side_by_side(scaled)
        hidden = self.xp.clip(hidden, -_LARGEST_NET_INPUT, _LARGEST_NET_INPUT)
        for number in range(len(self.shape.layers)):
            layer = net[f"hidden_{number}"]
            hidden = self.xp.tanh(hidden @ layer["kernel"] + layer["bias"])
        return hidden

    def _product(self, gains: Any, value: Any, own: int) -> Any:
        """Gains of pairs [*shape, *fluent's] times a fluent's value, summed over its objects.

        `own` is the number of axes of the shape.
        """
        axes = np.ndim(value) - self.is_replicated
        if np.ndim(gains) > own + axes:  # of each replica
            return np.sum(gains * value, axis=tuple(range(own, own + axes)))
        if self.is_replicated or np.size(gains) > _FEW_PAIRS:
            return self.xp.tensordot(gains, value, axes)
        return self.xp.sum(gains * value, axis=tuple(range(-axes, 0)))


def _normals(
    key: "Array | np.random.Generator", dtype: Any
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """What draws standard normal numbers: (number, shape) of a layer, and (shape) of the next."""
    if isinstance(key, np.random.Generator):
        generator = key

        def drawn(*arguments: Any) -> np.ndarray:
            return generator.standard_normal(arguments[-1]).astype(dtype)

        return drawn, drawn
    from jax import random

    latest = key

    def lifted(number: int, shape: tuple[int, ...]) -> Any:
        return random.normal(random.fold_in(random.fold_in(key, _LIFTED), number), shape, dtype)

    def net(shape: tuple[int, ...]) -> Any:
        nonlocal latest
        latest, own = random.split(latest)
        return random.normal(own, shape, dtype)

    return lifted, net
