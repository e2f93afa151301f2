"""Policies that decide for many replicas of the state at once; see `Replicated` there."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pyRDDLGym.core.compiler.model import RDDLLiftedModel

from mdpo_rddl.problem.observation import as_numbers

Arrays = Mapping[str, np.ndarray]


class BatchReplicas:
    """What decides for a batch, whose first axis has the replicas; always for as many at once.

    A last block of fewer replicas is filled up, so that no program is compiled for it.
    """

    def __init__(
        self,
        batch: Callable[[int, Arrays], Mapping[str, Any]],
        were_played: Callable[[Arrays], None],
        model: RDDLLiftedModel,
    ) -> None:
        """Takes them.

        Args:
          batch: of a step and an observation [B, *shape], the actions [B, *shape].
          were_played: is told of the actions [B, *shape] that were played.
          model: of the problem, lifted.
        """
        self._batch, self._told, self._model = batch, were_played, model
        self._most = 0

    def __call__(self, step: int, observation: Arrays) -> dict[str, np.ndarray]:
        """Per action fluent [*shape, B]."""
        count = next(iter(observation.values())).shape[-1]
        self._most = max(self._most, count)
        actions = self._batch(step, self._filled(observation))
        numbers = {name: as_numbers(self._model, name, each) for name, each in actions.items()}
        return {name: np.moveaxis(each, 0, -1)[..., :count] for name, each in numbers.items()}

    def were_played(self, actions: Arrays) -> None:
        """Tells it."""
        self._told(self._filled(actions))

    def _filled(self, arrays: Arrays) -> dict[str, np.ndarray]:
        count = next(iter(arrays.values())).shape[-1]
        places = np.minimum(np.arange(self._most), count - 1)
        return {name: np.moveaxis(value[..., places], -1, 0) for name, value in arrays.items()}


class DistinctStates:
    """What decides by the step and the state alone: once for each of the states of a step."""

    def __init__(
        self, act: Callable[[int, Arrays], Mapping[str, Any]], model: RDDLLiftedModel
    ) -> None:
        """Takes it.

        Args:
          act: of a step and N observations [N, *shape], the actions [N, *shape].
          model: of the problem, lifted.
        """
        self._act, self._model = act, model

    def __call__(self, step: int, observation: Arrays) -> dict[str, np.ndarray]:
        """Per action fluent [*shape, B]."""
        rows = [np.reshape(v, (-1, v.shape[-1])).astype(float) for v in observation.values()]
        _, first, places = np.unique(
            np.concatenate(rows), axis=1, return_index=True, return_inverse=True
        )
        seen = {name: np.moveaxis(v[..., first], -1, 0) for name, v in observation.items()}
        actions = {
            name: np.moveaxis(as_numbers(self._model, name, each), 0, -1)
            for name, each in self._act(step, seen).items()
        }
        return {name: each[..., np.ravel(places)] for name, each in actions.items()}

    def were_played(self, actions: Arrays) -> None:
        """It remembers nothing."""
