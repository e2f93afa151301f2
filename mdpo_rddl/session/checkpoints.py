"""The checkpoints of a training, in the folder that is there until its run is finished."""

import functools
import json
from pathlib import Path

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.training.checkpoints import Checkpoints, TrainingState
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
    parse = functools.partial(_state, terms.config)
    kept = KeptPair((folder / first, folder / second), _FORMAT, terms, parse)

    def save(state: TrainingState) -> None:
        kept.write(dict(state.tensors), {"numbers": json.dumps(dict(state.numbers))})

    return Checkpoints(seconds, save, kept.newest)


def _state(config: PlannerConfig, text: Metadata, tensors: Tensors) -> TrainingState:
    """A state; raises an error if no training of the configuration can have left its numbers."""
    state = TrainingState(tensors, dict(json.loads(text["numbers"])))
    sizes = config.section("MDPO")
    call = sizes.get("iterations_per_call", 1)
    state.require_numbers(config.budget().iterations, (call, sizes.get("test_every", call)))
    return state
