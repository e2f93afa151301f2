"""What the parallel updates of a planner may differ in: noise rules and step sizes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import optax
from jax import Array

from mdpo_rddl.noise import ActionNoise


@dataclass(frozen=True)
class PerRestart:
    """A guess for `optimize` that differs between the parallel updates.

    Attributes:
      params: parameters with a leading axis of restarts, each leaf [R, ...].
    """

    params: Any


@dataclass(frozen=True)
class AllLanes(PerRestart):
    """The same with the companions of paired noise among them, each leaf [lanes, ...]."""


def require_one_each(
    count: int,
    noise: Sequence[ActionNoise] | None,
    hyperparams: Mapping[str, Sequence[float]],
) -> None:
    """Checks that there is one value for each of `count` restarts.

    Raises:
      ValueError: if there are more or fewer.
    """
    for name, values in {"noise": noise, **hyperparams}.items():
        if values is not None and len(values) != count:
            raise ValueError(f"{name}: {count} needed, got {len(values)}")


class Restarts:
    """The noise rule and the optimiser's hyperparameters of each parallel update.

    Their numbers are arguments of the compiled update, so that others take no recompilation.
    """

    def __init__(self, noise: ActionNoise) -> None:
        self._noise = noise
        self._rules: Any = None
        self._hyperparams: dict[str, Array] = {}

    @property
    def noise(self) -> ActionNoise:
        """The rule of all, where they do not differ."""
        return self._noise

    @noise.setter
    def noise(self, noise: ActionNoise) -> None:
        self._require_same_kind(noise)
        self._noise, self._rules = noise, None

    def vary(
        self,
        noise: Sequence[ActionNoise] | None,
        hyperparams: Mapping[str, Sequence[float]],
        lay_out: Callable[[Any], Any],
    ) -> None:
        """Gives each its own values.

        Args:
          noise: the parallel updates' rules; all have `noise` if None.
          hyperparams: the parallel updates' values, by the names that optax injects them under.
          lay_out: puts arrays with a leading axis of restarts on the devices.

        Raises:
          ValueError: if a rule is of another kind.
        """
        for rule in noise or ():
            self._require_same_kind(rule)
        self._rules = None
        if noise is not None:
            self._rules = lay_out(jax.tree.map(lambda *leaves: jnp.stack(leaves), *noise))
        self._hyperparams = {
            name: lay_out(jnp.asarray(values, jnp.result_type(float)))
            for name, values in hyperparams.items()
        }

    def rules(self, broadcast: Callable[[Any], Any]) -> Any:
        """The rules as one tree with a leading axis of restarts.

        Args:
          broadcast: adds that axis to a tree.
        """
        return broadcast(self._noise) if self._rules is None else self._rules

    def with_hyperparams(self, opt_state: Any) -> Any:
        """The optimiser's batched state with each restart's own hyperparameters."""
        if not self._hyperparams:
            return opt_state
        return optax.tree_utils.tree_set(opt_state, **self._hyperparams)

    def _require_same_kind(self, noise: ActionNoise) -> None:
        kinds = [str(jax.tree.structure(rule)) for rule in (noise, self._noise)]
        if kinds[0] != kinds[1] or noise.silent != self._noise.silent:
            raise ValueError(f"compiled for {self._noise}, cannot change to {noise}")
