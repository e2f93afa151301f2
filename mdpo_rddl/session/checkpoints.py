"""The checkpoints of a training, in the folder that is there until its run is finished."""

import json
from pathlib import Path

from mdpo_rddl.planner.checkpoints import Checkpoints, TrainingState
from mdpo_rddl.policy.container import Metadata, Tensors
from mdpo_rddl.session.kept import KeptPair
from mdpo_rddl.session.requests import FindTerms
from mdpo_rddl.session.unfinished import TRAINING_FILES

_FORMAT = "mdpo-rddl checkpoint 2"


def training_checkpoints(folder: Path, terms: FindTerms, seconds: float) -> Checkpoints:
    """Where a training leaves its states, and the newest one that is there.

    Args:
      folder: that is there.
      terms: what is planned.
      seconds: from one checkpoint to the next.

    Raises:
      InputError: if there are checkpoints, but none that can be used.
    """
    first, second = TRAINING_FILES
    kept = KeptPair((folder / first, folder / second), _FORMAT, terms, _state)

    def save(state: TrainingState) -> None:
        kept.write(dict(state.tensors), {"numbers": json.dumps(dict(state.numbers))})

    return Checkpoints(seconds, save, kept.newest)


def _state(text: Metadata, tensors: Tensors) -> TrainingState:
    state = TrainingState(tensors, dict(json.loads(text["numbers"])))
    if state.iterations < 1 or not state.seconds >= 0.0:
        raise ValueError("its numbers are not those of a training")
    return state
