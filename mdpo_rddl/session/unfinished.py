"""Names in the folder of a run that is not finished; nothing that takes long to import."""

UNFINISHED = ".unfinished"
"""What that folder has after the name of the run's."""

TRAINING_FILES = ("checkpoint-0.safetensors", "checkpoint-1.safetensors")
"""The newest checkpoint of a training and the one before, in turn."""

RACE_FILES = ("incumbent-0.safetensors", "incumbent-1.safetensors")
"""The best policy of a race and the one before, in turn."""

CHECKPOINTS = {*TRAINING_FILES, *RACE_FILES}
