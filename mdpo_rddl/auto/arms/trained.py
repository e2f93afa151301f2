"""What an arm is that goes on with one training, from slice to slice and process to process."""

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.compiling import CompilingArm
from mdpo_rddl.auto.common.state import State
from mdpo_rddl.auto.common.training_state import checkpoints_of
from mdpo_rddl.planner.training.training import Training, TrainingResult

REPLAY_SECONDS = 2.0
"""To find what is not finite, while the other arms wait."""


class TrainedArm(CompilingArm):
    """An arm with a training, which it may have from another process."""

    def __init__(self, name: str, arena: Arena, usual_seconds: float = 0.0) -> None:
        """Compiles nothing yet; the arguments are those of `CompilingArm`."""
        super().__init__(name, arena, usual_seconds)
        self._training: Training | None = None
        # what another process has left, until it is known to fit
        self._resumed: State | None = None

    def restore(self, state: State) -> None:
        """Keeps it until the program is compiled."""
        checkpoints_of(state.part("training"))  # raises if there is none
        self._resumed = state

    def close(self) -> None:
        """Leaves the planner as it was before the training."""
        if self._training is not None:
            self._training.close()

    def _note_not_finite(self, training: Training, result: TrainingResult) -> None:
        """Counts what is not finite, in the worst phase, and says once where it arises."""
        count, details = result.not_finite + result.lost_sensitivities, self._log.details
        if count and "advice" not in details:
            advice = result.advice or training.diagnosis(seconds=REPLAY_SECONDS)
            self._log.details = {**details, "advice": advice}
        if count:
            count = max(count, details.get("not_finite", 0))
            self._log.details = {**self._log.details, "not_finite": count}
