"""What the iterations of a training have found so far."""

import copy
import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.planner.training.fitting import fitted, fitted_leaves
from mdpo_rddl.planner.update.finite import are_finite

# at most so many iterations are recorded, and the last one
_RECORDS = 600
_KEPT = ("iteration", "train_return", "test_return", "sigma")


_NUMBERS = (
    "restart",
    "test_return",
    "best_return",
    "best_iteration",
    "best_restart",
    "not_finite",
    "first_not_finite",
    "lost_sensitivities",
    "flat",
    "sloped",
    "callbacks",
)


class Found:
    """What the iterations so far have found.

    The best iterate of JaxPlan's own loop is not used: once a restart's return is not a number,
    JaxPlan takes that restart for the best one and no longer sees the others. Calls of several
    iterations keep account of it themselves.

    Attributes:
      not_finite: training and test returns that were not finite.
      first_not_finite: the iteration of the first.
      suspect: the parameters of one policy before that; None if it was the first iteration.
      lost_sensitivities: those of a step that were not finite, in the iterations that callbacks
        are of; they count as zero.
      flat, sloped: iterations whose gradients were all zero, and the others.
      callbacks: that were taken in: iterations, or calls of several.
    """

    def __init__(self, in_calls: bool) -> None:
        self._in_calls = in_calls
        self.callback: Mapping[str, Any] = {}
        self.restart = 0
        self.test_return = -np.inf
        self.best_return, self.best_iteration = -np.inf, 0
        self._best_params: Callable[[], Any] = lambda: None
        self.best_restart = 0
        self._kept: list[dict[str, Any]] = []
        self._every = 1
        self.not_finite, self.first_not_finite, self.lost_sensitivities = 0, 0, 0
        self.suspect: Any = None
        self.flat = self.sloped = self.callbacks = 0

    @classmethod
    def resumed(
        cls,
        in_calls: bool,
        tensors: dict[str, np.ndarray],
        structure: Any,
        shape: tuple[int, int],
    ) -> "Found":
        """What `tensors` has made tensors of.

        Args:
          in_calls: as of the training.
          tensors: by their names.
          structure: shapes and types of the parameters of one policy.
          shape: number of restarts and horizon.

        Raises:
          KeyError, ValueError: if something is missing or does not fit.
        """
        found = cls(in_calls)
        # checkpoints of earlier versions do not count sensitivities, nor callbacks
        recorded = tensors["every"].item() * len(tensors["kept/iteration"])
        defaults = {"lost_sensitivities": np.asarray(0), "callbacks": np.asarray(recorded)}
        tensors = {**defaults, **tensors}
        numbers = {name: tensors[name].item() for name in _NUMBERS}
        for name, value in numbers.items():
            setattr(found, name, value if name.endswith("_return") else int(value))
        treedef = jax.tree.structure(structure)
        best = jax.tree.unflatten(treedef, fitted_leaves("best_params", tensors, structure))
        found._best_params = lambda: best
        if "suspect/0" in tensors:
            suspect = fitted_leaves("suspect", tensors, structure)
            found.suspect = jax.tree.unflatten(treedef, suspect)
        found._every = tensors["every"].item()
        kept = {name: tensors[f"kept/{name}"] for name in _KEPT}
        count, restarts = len(kept["iteration"]), shape[0]
        shapes = {"iteration": (count,), "sigma": (count, *shape)}
        for name, values in kept.items():
            fitted(f"kept/{name}", values, shapes.get(name, (count, restarts)), values.dtype)
        if not 0 <= found.restart < restarts or not 0 <= found.best_restart < restarts:
            raise ValueError(f"it names a restart that is none of the planner's {restarts}")
        found._require_counts(kept["iteration"])
        for i in range(count):
            entry = {name: values[i] for name, values in kept.items()}
            # JAX's mean of a profile rounds otherwise than numpy's
            entry["sigma"] = jnp.asarray(entry["sigma"])
            found._kept.append({**entry, "iteration": int(entry["iteration"])})
        return found

    def _require_counts(self, recorded: np.ndarray) -> None:
        """Raises a ValueError unless these are numbers that iterations leave.

        Args:
          recorded: numbers of the recorded iterations.
        """
        for name in _NUMBERS:
            value = getattr(self, name)
            if math.isnan(value) if name.endswith("_return") else value < 0:
                raise ValueError(f"its {name} is {value}")
        every = self._every
        if not (isinstance(every, int) and every >= 1):
            raise ValueError(f"it records every {every}th iteration")
        if recorded.dtype.kind not in "iu" or not _is_in_order(recorded):
            raise ValueError("its recorded iterations are not in order")

    def snapshot(self) -> "Found":
        """A copy that further iterations do not change."""
        found = copy.copy(self)
        found._kept = list(self._kept)
        return found

    def tensors(self) -> dict[str, np.ndarray]:
        """All of it but the last callback."""
        found = {name: np.asarray(getattr(self, name)) for name in _NUMBERS}
        found["every"] = np.asarray(self._every)
        for name, tree in {"best_params": self.best_params, "suspect": self.suspect}.items():
            for i, leaf in enumerate(jax.tree.leaves(tree)):
                found[f"{name}/{i}"] = np.asarray(leaf)
        for name in _KEPT:
            found[f"kept/{name}"] = np.stack([np.asarray(entry[name]) for entry in self._kept])
        return found

    def add(self, callback: Mapping[str, Any]) -> None:
        """Takes in what an iteration has found."""
        self._check(callback)
        returns = np.asarray(callback["test_return"])
        is_comparable = np.isfinite(returns) & are_finite(callback["params"])
        returns = np.where(is_comparable, returns, -np.inf)
        self.restart = int(np.argmax(returns))
        self.test_return = float(returns[self.restart])
        if self._in_calls:
            self.best_return = float(callback["best_return"])
            self.best_iteration = callback["last_iteration_improved"]
            self.best_restart = callback["best_index"]
            self._best_params = partial(callback.get, "best_params")
        elif self.test_return > self.best_return:
            self.best_return, self.best_iteration = self.test_return, callback["iteration"]
            self.best_restart = self.restart
            self._best_params = partial(select_restart, callback["params"], self.restart)
        # how many iterations the seconds allow is not known before
        if self.callbacks % self._every == 0:
            self._kept.append({name: callback[name] for name in _KEPT})
        self.callbacks += 1
        if len(self._kept) > _RECORDS:
            self._kept, self._every = self._kept[::2], 2 * self._every
        self.callback = callback

    def _check(self, callback: Mapping[str, Any]) -> None:
        if not callback["status"].is_terminal():  # the last one says why it was the last
            is_flat = callback["status"].name == "NO_PROGRESS"
            self.flat, self.sloped = self.flat + is_flat, self.sloped + (not is_flat)
        sensitivities = np.asarray(callback.get("sensitivity", [[0.0]]))
        lost = ~np.isfinite(sensitivities)
        finite = np.stack(
            [np.isfinite(callback["train_return"]), np.isfinite(callback["test_return"])]
        )
        if finite.all() and not lost.any():
            return
        if not self.not_finite and not finite.all():
            self.first_not_finite = callback["iteration"]
        if not self.not_finite and not self.lost_sensitivities and self.callback:
            lanes = lost.any(axis=1) if finite.all() else ~finite.all(axis=0)
            self.suspect = select_restart(self.callback["params"], int(np.argmax(lanes)))
        self.not_finite += int(np.sum(~finite))
        self.lost_sensitivities += int(np.sum(lost))

    @property
    def is_flat(self) -> bool:
        """Whether no iteration had a gradient other than zero."""
        return self.flat > 0 and self.sloped == 0

    @property
    def best_params(self) -> Any:
        """Parameters of the best iterate."""
        return self._best_params()

    @property
    def kept(self) -> list[dict[str, Any]]:
        """The recorded iterations, and the last one."""
        last = {name: self.callback[name] for name in _KEPT}
        is_kept = self._kept[-1]["iteration"] == last["iteration"]
        return self._kept if is_kept else [*self._kept, last]


def _is_in_order(counts: np.ndarray) -> bool:
    return bool(np.all(np.diff(counts) >= 0) and np.all(counts[:1] >= 0))


def select_restart(params_by_restart: Any, restart: int) -> Any:
    """The parameters of one restart out of a tree with a leading axis [restarts, ...]."""
    return jax.tree.map(lambda leaf: leaf[restart], params_by_restart)
