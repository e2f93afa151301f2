"""Work for jobs that end badly the first time; imported by the jobs too."""

import os
import signal
from pathlib import Path


def write_name(task: tuple[Path, str]) -> None:
    """Writes a file of the task's name, unless the name says otherwise."""
    folder, name = task
    begun = folder / f"{name}.begun"
    is_first = not begun.exists()
    begun.touch()
    if is_first and name == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if name == "raising":
        raise ValueError("no such number\n  anywhere")
    (folder / name).write_text(os.environ["SLURM_CPUS_PER_TASK"])
