"""What every action noise has in common."""

import abc
import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

from jax import Array

from mdpo_rddl.noise.units import ABSOLUTE


class NoiseProfile(NamedTuple):
    """How strongly to perturb each step of one update rollout.

    Attributes:
      sigma: scale of the noise per step [H]. For reals and integers it is the standard
        deviation, in the rule's unit; for bools and choices the scale of the logistic or
        Gumbel law on their log-odds or logits.
      sensitivity: the raw sensitivity score s_t per step [H], in return per unit of action;
        zeros where no analysis rollout was made.
    """

    sigma: Array
    sensitivity: Array


class ActionNoise(abc.ABC):
    """A rule that turns what the analysis rollout found into a noise profile.

    Implementations are frozen dataclasses registered with
    `jax.tree_util.register_dataclass`, so that their numbers are arguments of the compiled
    update rather than constants in it. A user's own rule needs no more than `profile`:

        @jax.tree_util.register_dataclass
        @dataclass(frozen=True)
        class FrontLoaded(ActionNoise):
            sigma: float = 1.0

            def profile(self, gradients, state, horizon):
                sigma = self.sigma * jnp.linspace(1.0, 0.0, horizon)
                return NoiseProfile(sigma, jnp.zeros(horizon)), state
    """

    analysis_samples = 0
    """Noise-free rollouts to differentiate before each update; 0 makes none."""

    unit: str = ABSOLUTE
    """What a scale of 1 means: "absolute", one unit of the raw action (of the plan, if it has
    units of its own), or "range", the width of the action's box (`mdpo_rddl.noise.units`)."""

    paired: bool = False
    """Whether each parallel update has another one beside it that has no noise."""

    @property
    def silent(self) -> bool:
        """Whether the rule never perturbs anything, so that the plain planner can run instead."""
        return False

    def scaled(self, factor: float) -> Self:
        """The same rule with all its scales, the fields called sigma..., times a factor."""
        if not dataclasses.is_dataclass(self):
            raise TypeError(f"{type(self).__name__} is no dataclass")
        names = [field.name for field in dataclasses.fields(self)]
        scales = {name: factor * getattr(self, name) for name in names if name.startswith("sigma")}
        return dataclasses.replace(self, **scales)

    def initial_state(self, horizon: int) -> Any:
        """State that the rule carries from one iteration to the next: a pytree, here empty."""
        del horizon
        return ()

    def advance(self, state: Any) -> Any:
        """The state for a replan one decision later; here the same."""
        return state

    @abc.abstractmethod
    def profile(
        self, gradients: Mapping[str, Array] | None, state: Any, horizon: int
    ) -> tuple[NoiseProfile, Any]:
        """The next update rollout's profile, as a pure function.

        Args:
          gradients: per action fluent, the gradient of the return with respect to the raw
            action at each step [H, *action shape]. If `analysis_samples` is 0, that of the
            update before (zeros before the first) where the plan can tell it, else None.
          state: the state that the last call returned, or `initial_state`.
          horizon: number of steps H.

        Returns:
          The profile and the next state.
        """
