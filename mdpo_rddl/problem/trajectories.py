"""Trajectories of all fluents over several episodes, in bounded memory."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyRDDLGym.core.compiler.model import RDDLLiftedModel

from mdpo_rddl.problem.observation import is_observed

KINDS = ("state", "action")
MOST_STEPS = 500
"""The most steps of an episode that are recorded."""

_MOST_NUMBERS = 4_000_000
_FEWEST_EPISODES = 5
_LONGEST_NAME = 1_000


@dataclass(frozen=True)
class Fluent:
    """One fluent as it is recorded.

    Attributes:
      kind: "state", or "action".
      name: the domain's.
      range: "real", "int", "bool" or the name of an enumerated type.
      objects: the recorded objects' names, such as "t1" or "t1, t2"; "" for one without any.
      count: how many objects there are.
      values: names of the values of an enumerated type, whose places are recorded.
    """

    kind: str
    name: str
    range: str
    objects: tuple[str, ...]
    count: int
    values: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Trajectories:
    """What was seen and played.

    Attributes:
      fluents: those that are recorded.
      steps: numbers of the recorded steps [T], from 0.
      values: per fluent, by its kind and its name, [episodes, T, objects]: bools as 0 and 1,
        enumerated values as their places; NaN after an episode's end and for what is not observed.
      rewards: [episodes, T]; NaN after an episode's end.
    """

    fluents: tuple[Fluent, ...]
    steps: np.ndarray
    values: Mapping[tuple[str, str], np.ndarray]
    rewards: np.ndarray

    def arrays(self, prefix: str) -> dict[str, np.ndarray]:
        """Named arrays, for an `.npz` file: prefix/kind/NAME, prefix/reward, prefix/steps."""
        named = {f"{prefix}/{kind}/{name}": v for (kind, name), v in self.values.items()}
        return {**named, f"{prefix}/reward": self.rewards, f"{prefix}/steps": self.steps}

    @classmethod
    def from_arrays(
        cls, fluents: tuple[Fluent, ...], arrays: Mapping[str, np.ndarray], prefix: str
    ) -> "Trajectories":
        """What `arrays` has named.

        Raises:
          KeyError: if an array is missing.
        """
        values = {(f.kind, f.name): arrays[f"{prefix}/{f.kind}/{f.name}"] for f in fluents}
        return cls(fluents, arrays[f"{prefix}/steps"], values, arrays[f"{prefix}/reward"])


def fluents_text(fluents: tuple[Fluent, ...]) -> str:
    """Descriptions of fluents as JSON."""
    return json.dumps([vars(fluent) for fluent in fluents])


def parse_fluents(text: str) -> tuple[Fluent, ...]:
    """What `fluents_text` has written.

    Raises:
      ValueError: if it is something else, or a name has more than 1,000 characters.
    """
    try:
        fluents = tuple(
            Fluent(**{**each, "objects": tuple(each["objects"]), "values": tuple(each["values"])})
            for each in json.loads(text)
        )
    except (TypeError, KeyError, RecursionError) as error:
        raise ValueError(f"no descriptions of fluents: {error}") from error
    for fluent in fluents:
        words = (fluent.kind, fluent.name, fluent.range, *fluent.objects, *fluent.values)
        if type(fluent.count) is not int or not all(isinstance(word, str) for word in words):
            raise ValueError("no descriptions of fluents: one has a value of another kind")
        if any(len(word) > _LONGEST_NAME for word in words):
            raise ValueError(f"a name of more than {_LONGEST_NAME:,} characters")
    return fluents


class TrajectoriesRecorder:
    """Records the first episodes of an evaluation, as many as memory is given for.

    Of a long horizon every n-th step is kept; of a fluent of many objects as many as there is room
    for, evenly spread.
    """

    def __init__(
        self, model: RDDLLiftedModel, episodes: int, most_numbers: int = _MOST_NUMBERS
    ) -> None:
        """Chooses what is kept.

        Args:
          model: of the problem.
          episodes: that will be played.
          most_numbers: the most numbers that all fluents may take together.
        """
        self._stride = -(-model.horizon // MOST_STEPS)
        self._steps = np.arange(0, model.horizon, self._stride)
        self._places: dict[tuple[str, str], np.ndarray] = {}
        room = max(1, most_numbers // len(self._steps))
        ranges = _ranges(model)
        sizes = {key: _count(model, key[1]) for key in ranges}
        self._kept = int(np.clip(room // max(1, sum(sizes.values())), _FEWEST_EPISODES, episodes))
        self._kept = min(self._kept, episodes)
        most_objects = max(1, room // (self._kept * max(1, len(sizes))))
        fluents = []
        for (kind, name), size in sizes.items():
            most = size if self._kept * sum(sizes.values()) <= room else min(size, most_objects)
            places = np.unique(np.linspace(0, size - 1, most).astype(int))
            self._places[kind, name] = places
            value_range = ranges[kind, name]
            fluents.append(
                Fluent(
                    kind=kind,
                    name=name,
                    range=value_range,
                    objects=_objects(model, name, places),
                    count=size,
                    values=tuple(v.lstrip("@") for v in model.type_to_objects.get(value_range, ())),
                )
            )
        self._fluents = tuple(fluents)
        self._codes = {
            (f.kind, f.name): {value: code for code, value in enumerate(f.values)}
            for f in fluents
            if f.values
        }
        self._episodes: list[_EpisodeRecord] = []
        self._begun = 0
        self._noop = dict(model.action_fluents)
        self._is_hidden = bool(model.observ_fluents)

    @property
    def kept(self) -> int:
        """How many episodes are recorded."""
        return self._kept

    def of_replicas(
        self,
        states: Mapping[str, np.ndarray],
        actions: Mapping[str, np.ndarray],
        rewards: np.ndarray,
        lengths: np.ndarray,
    ) -> Trajectories:
        """The same of episodes that were played side by side.

        Args:
          states: per fluent that is observed, before each step and at the end [T + 1, *shape, B].
          actions: per action fluent [T, *shape, B].
          rewards: [T, B].
          lengths: numbers of steps [B].
        """
        given = {"state": states, "action": actions}
        steps = self._steps[self._steps < len(rewards)]
        count = min(self._kept, len(lengths))
        is_over = steps >= lengths[:count, np.newaxis]

        def kept(values: np.ndarray, places: np.ndarray, first: int = 0) -> np.ndarray:
            flat = values[: len(rewards)].reshape(len(rewards), -1, len(lengths))
            found = np.full((count, len(self._steps), len(places)), np.nan, np.float32)
            part = np.moveaxis(flat[steps][:, places, :count], -1, 0)
            found[:, : len(steps)] = np.where(is_over[..., np.newaxis], np.nan, part)
            found[:, :first] = np.nan
            return found

        # before the first step of a partially observed problem nothing is observed
        first = {"state": 1 if self._is_hidden else 0, "action": 0}
        values = {
            (kind, name): kept(given[kind][name], places, first[kind])
            for (kind, name), places in self._places.items()
        }
        return Trajectories(
            self._fluents, self._steps, values, kept(rewards, np.zeros(1, int))[..., 0]
        )

    def begin(self) -> "_EpisodeRecord | None":
        """The recorder of the next episode; None once enough are kept."""
        self._begun += 1
        if self._begun > self._kept:
            return None
        self._episodes.append(_EpisodeRecord(self))
        return self._episodes[-1]

    def result(self) -> Trajectories:
        """What was recorded so far."""
        values = {
            key: self._stacked([e.values[key] for e in self._episodes], (len(places),))
            for key, places in self._places.items()
        }
        rewards = self._stacked([e.rewards for e in self._episodes], ())
        return Trajectories(self._fluents, self._steps, values, rewards)

    def numbers(self, key: tuple[str, str], value: Any) -> np.ndarray:
        """A fluent's value as numbers of the objects that are kept [objects]."""
        places = self._places[key]
        if value is None or not is_observed(value):
            return np.full(len(places), np.nan, np.float32)
        flat = np.ravel(np.asarray(value))
        flat = flat[places] if flat.size > 1 else np.repeat(flat, len(places))
        if flat.dtype.kind in "US":
            codes = self._codes.get(key, {})
            return np.array([codes.get(str(each).lstrip("@"), np.nan) for each in flat], np.float32)
        return flat.astype(np.float32)

    def default(self, name: str) -> Any:
        """The value of an action fluent that an action leaves out."""
        return self._noop[name]

    @property
    def keys(self) -> list[tuple[str, str]]:
        """Kind and name of each recorded fluent."""
        return list(self._places)

    def is_kept(self, step: int) -> bool:
        """Whether a step is recorded."""
        return step % self._stride == 0

    def _stacked(self, episodes: list[list[Any]], shape: tuple[int, ...]) -> np.ndarray:
        """Episodes of unequal lengths, of values [*shape], as one array, filled up with NaN."""
        stacked = np.full((len(episodes), len(self._steps), *shape), np.nan, np.float32)
        for number, episode in enumerate(episodes):
            if episode:
                stacked[number, : len(episode)] = episode
        return stacked


class _EpisodeRecord:
    """One episode's recorder."""

    def __init__(self, recorder: TrajectoriesRecorder) -> None:
        self._recorder, self._step = recorder, 0
        self.values: dict[tuple[str, str], list[np.ndarray]] = {key: [] for key in recorder.keys}
        self.rewards: list[float] = []

    def add(self, state: Mapping[str, Any], actions: Mapping[str, Any], reward: float) -> None:
        """One step: what was observed before it, what was played, what it paid."""
        recorder, step = self._recorder, self._step
        self._step += 1
        if not recorder.is_kept(step):
            return
        for kind, name in self.values:
            value = state.get(name) if kind == "state" else actions.get(name)
            if value is None and kind == "action":
                value = recorder.default(name)
            self.values[kind, name].append(recorder.numbers((kind, name), value))
        self.rewards.append(reward)


def _ranges(model: RDDLLiftedModel) -> dict[tuple[str, str], str]:
    """The range of each fluent that a policy sees or plays."""
    seen = model.observ_ranges if model.observ_fluents else model.state_ranges
    kinds = zip(KINDS, (seen, model.action_ranges), strict=True)
    return {(kind, name): text for kind, ranges in kinds for name, text in ranges.items()}


def _count(model: RDDLLiftedModel, name: str) -> int:
    """How many ground fluents a fluent has."""
    return math.prod(model.object_counts(model.variable_params[name]))


def _objects(model: RDDLLiftedModel, name: str, places: np.ndarray) -> tuple[str, ...]:
    """Names of the objects at places of a fluent's flat array."""
    types = model.variable_params[name]
    if not types:
        return ("",)
    indices = np.unravel_index(places, model.object_counts(types))
    columns = [
        [model.type_to_objects[kind][i] for i in index]
        for kind, index in zip(types, indices, strict=True)
    ]
    return tuple(", ".join(names) for names in zip(*columns, strict=True))
