"""Checkpoints of races with something in them changed, and who must bear them."""

import random
import tempfile
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from helpers.clocks import Ticking
from helpers.config_texts import TEXT
from helpers.toys import toy
from mdpo_rddl.auto.common.arm_log import ArmLog
from mdpo_rddl.auto.common.candidate import Candidate, Judged
from mdpo_rddl.auto.common.state import UNFIT, State
from mdpo_rddl.auto.probing.probing import Probe
from mdpo_rddl.auto.race.resumption import Resumption
from mdpo_rddl.auto.resuming.race_state import RaceState
from mdpo_rddl.auto.search.archive import Archive
from mdpo_rddl.auto.search.cma import Adaptation, Sampling
from mdpo_rddl.auto.search.mutations import layout_of
from mdpo_rddl.auto.search.trials.trials import TrialSearch
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.container import read_container, write_container
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import GroundModel, ground_model
from mdpo_rddl.session.race_checkpoints import RaceCheckpoints
from mdpo_rddl.session.unfinished import RACE_FILES

FORMAT = "mdpo-rddl race 4"
HORIZON = 6
LAYOUT = layout_of({"push": np.zeros((HORIZON, 2))}, [])


class _Cells:
    """An archive that is restored as the other searches are."""

    def __init__(self) -> None:
        self._archive = Archive(LAYOUT, {"x": (0.0, 1.0)}, seed=0)

    def filled(self) -> "_Cells":
        plans = np.ones((2, HORIZON, 2), np.float32)
        self._archive.add(plans, {"x": np.cumsum(plans[:, :, 0], axis=1)})
        return self

    def state(self) -> State:
        return self._archive.state()

    def restore(self, state: State) -> None:
        self._archive.restore(state, HORIZON)

    def run(self, evaluate: Any, until: float) -> None:
        self._archive.plans(2)


@cache
def _model() -> GroundModel:
    return ground_model(toy("quest"), EnumerationLimits(seconds=1e9))


class _Seen:
    """A search by trials that is restored as the other searches are."""

    def __init__(self) -> None:
        self._search = TrialSearch(_model(), EnumerationLimits(seconds=1e9), 0, Ticking())

    def state(self) -> State:
        self._search.work(20.0)
        return self._search.state()

    def restore(self, state: State) -> None:
        for _ in self._search.restoring(state):
            pass

    def run(self, evaluate: Any, until: float) -> None:
        self._search.work(5.0)
        self._search.found(0.0)


def searches() -> dict[str, Any]:
    """What goes on with a state, by the names of arms."""
    sampling = Sampling(sigma=0.5, population=8, seed=1)
    return {
        "shared weights": Adaptation(np.zeros(3), sampling, Ticking()),
        "exploration": _Cells().filled(),
        "trials": _Seen(),
    }


def terms() -> Any:
    """Of the race that the checkpoint is of."""
    problem = SimpleNamespace(digest="d", horizon=HORIZON)
    return SimpleNamespace(problem=problem, seed=3, config=PlannerConfig.from_text(TEXT, "a.cfg"))


def read(folder: Path, chance: random.Random, change: Any) -> None:
    """Reads a changed checkpoint, restores the searches, and has them go on a little.

    Args:
      folder: where it is.
      chance: what to change.
      change: changes a text.

    Raises:
      InputError: if the checkpoint or a state is refused.
    """
    path = folder / RACE_FILES[0]
    path.write_bytes(checkpoint())
    text, tensors = read_container(path, (FORMAT,))
    name = chance.choice(["state", "state", "about", "curve", "seconds", "number", "terms"])
    if chance.random() < 0.7:
        text[name] = change(text[name], chance).replace("\x00", "")
    else:
        key = chance.choice(sorted(tensors))
        flat = tensors[key].reshape(-1)
        tensors[key] = chance.choice([flat[:1], flat * 0 - 1, flat.astype(np.int8), flat[:0]])
    write_container(path, tensors, text)
    start = RaceCheckpoints(folder, terms(), 60.0).start
    assert start is not None
    if start.state is None:
        raise InputError("the state is left out")
    Resumption(lambda: 0.0, start.state).snapshot().flat()
    for arm, search in searches().items():
        state = start.state.states.get(arm)
        try:
            if state is not None:
                search.restore(state)
                search.run(lambda number, vectors: -np.sum(vectors**2, axis=1), 3.5)
                assert isinstance(search, _Cells | _Seen) or search.iterations > 0
        except UNFIT as error:
            raise InputError(f"{arm}: {error}") from error


@cache
def checkpoint() -> bytes:
    """A checkpoint as a race writes it."""
    log = ArmLog("pgpe", slices=2, seconds=3.0, iterations=7, best_return=-5.0)
    state = RaceState(
        seconds=9.0,
        marks={
            "ends": {"rounds": 50.0},
            "begun": [],
            "over": ["rules"],
            "decided": {"found": True},
        },
        contenders={"pgpe": {"slices": 2, "pace": 0.5, "waited": 1}},
        logs={"pgpe": log},
        states={name: search.state() for name, search in searches().items()},
        probe=Probe(
            units={"push": 3.0},
            state_scales={"x": (1.0, 2.0)},
            noop_return=-7.0,
            start={"push": np.array([0.5, 1.0])},
            start_return=-3.0,
            deterministic=False,
            certain=False,
            policy_seconds=None,
        ),
    )
    params = {"rule": {"w": np.arange(6.0).reshape(2, 3)}}
    found = Candidate("pgpe", "pgpe, mean", terms().config, None, params, mean=-5.0, error=0.5)
    with tempfile.TemporaryDirectory() as folder:
        checkpoints = RaceCheckpoints(Path(folder), terms(), 60.0)
        checkpoints.begun(lambda: state)
        checkpoints.judged(Judged(found, 1.0, became_incumbent=True))
        return (Path(folder) / RACE_FILES[0]).read_bytes()
