"""On a Slurm cluster, as a job array."""

import hashlib
import logging
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from mdpo_rddl.errors import InputError

T = TypeVar("T")

logger = logging.getLogger(__name__)

_LOST = "its jobs ended without a word"
# a result may reach us later than the news that its job has left the queue
_GRACE_LOOKS = 3


class _Resumable:
    """A task's work as submitit requeues it."""

    def __init__(self, work: Callable[[Any], None]) -> None:
        self._work = work

    def __call__(self, task: Any) -> None:
        logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
        self._work(task)

    def checkpoint(self, task: Any) -> Any:
        """What the requeued job does: the same, since the work goes on where it was left."""
        from submitit.helpers import DelayedSubmission

        return DelayedSubmission(self, task)


@dataclass(frozen=True)
class SlurmExecutor:
    """Submits the tasks through submitit, and waits for them.

    A job that is preempted or comes to its time limit is requeued and goes on from what its task
    has written. A task whose job ends without a word (a lost node, too much memory) is submitted
    again. Of the queue only `squeue` is asked, so that no accounting is needed.

    Attributes:
      folder: for submitit's scripts and the jobs' logs; all machines must see it.
      cpus: of each job.
      memory_gb: of each job.
      minutes: time limit of each job.
      partition: Slurm's default if None.
      parallel: most jobs at a time.
      requeues: how often a job may come to its time limit.
      submissions: how often a task is submitted in all.
      signal_seconds: how long before its limit a job is told of it.
      look_seconds: from one look at the queue to the next.
    """

    folder: Path
    cpus: int = 2
    memory_gb: float = 8.0
    minutes: int = 240
    partition: str | None = None
    parallel: int = 256
    requeues: int = 10
    submissions: int = 3
    signal_seconds: int = 90
    look_seconds: float = 2.0

    def run(self, work: Callable[[T], None], tasks: Sequence[T]) -> None:
        """Runs each task as a job; an interrupt cancels the jobs.

        Raises:
          InputError: if submitit or Slurm is missing here, or Slurm refuses the jobs, or jobs of
            an earlier run on this folder have not ended; if a task failed, with its error and the
            folder of the logs, after all others have ended.
        """
        submitter, failures = self._submitter(), []
        if earlier := _queued(self._name):
            raise InputError(
                f"{self.folder}: {len(earlier)} jobs of an earlier run have not ended; wait for "
                f"them or end them by: scancel --name={self._name}"
            )
        waiting = _submit(submitter, work, tasks, range(len(tasks)))
        submissions = Counter(waiting.values())
        unseen: Counter[Any] = Counter()
        try:
            while waiting:
                time.sleep(self.look_seconds)
                queued, lost = _queued(self._name), []
                for job in list(waiting):
                    if job.paths.result_pickle.exists():
                        del waiting[job]
                        failures += _failures(job)
                    elif queued is not None and job.job_id not in queued:
                        unseen[job] += 1
                        if unseen[job] > _GRACE_LOOKS:
                            lost.append(waiting.pop(job))
                again = [number for number in lost if submissions[number] < self.submissions]
                failures += [_LOST] * (len(lost) - len(again))
                waiting |= _submit(submitter, work, tasks, again)
                submissions.update(again)
        except BaseException:
            subprocess.run(["scancel", f"--name={self._name}", "--me"], check=False)
            raise
        if failures:
            count = f"{len(failures)} of {len(tasks)} tasks failed"
            raise InputError(f"{self.folder}: {count}, see the logs there; first: {failures[0]}")

    @property
    def _name(self) -> str:
        """The jobs' name in the queue, the same for all runs on one folder."""
        return "mdpo-" + hashlib.sha256(bytes(self.folder.resolve())).hexdigest()[:8]

    def _submitter(self) -> Any:
        try:
            import submitit
        except ImportError as error:
            raise InputError("Slurm needs submitit: pip install 'mdpo-rddl[slurm]'") from error
        try:
            submitter = submitit.SlurmExecutor(self.folder, max_num_timeout=self.requeues)
        except RuntimeError as error:
            raise InputError(f"there is no Slurm here: {error}") from error
        except OSError as error:
            raise InputError(f"{self.folder}: cannot be written: {error.strerror}") from error
        submitter.update_parameters(
            job_name=self._name,
            cpus_per_task=self.cpus,
            mem=f"{round(self.memory_gb * 1024)}M",
            time=self.minutes,
            array_parallelism=self.parallel,
            signal_delay_s=self.signal_seconds,
            **({} if self.partition is None else {"partition": self.partition}),
        )
        return submitter


def _submit(
    submitter: Any, work: Callable[[T], None], tasks: Sequence[T], numbers: Sequence[int]
) -> dict[Any, int]:
    """Submits the tasks of these numbers as one array; per job the number of its task."""
    if not numbers:
        return {}
    try:
        jobs = submitter.map_array(_Resumable(work), [tasks[number] for number in numbers])
    except Exception as error:  # submitit's own, with what sbatch said
        cause = " ".join(str(error).split())
        raise InputError(f"Slurm does not take the jobs: {cause}") from error
    logger.info("%d jobs submitted", len(jobs))
    return dict(zip(jobs, numbers, strict=True))


def _queued(name: str) -> set[str] | None:
    """The ids of our jobs of this name that have not ended; None if Slurm does not answer."""
    command = ["squeue", "--me", f"--name={name}", "--noheader", "--array", "--format=%i"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        logger.warning("squeue does not answer: %s", error)
        return None
    return set(answer.stdout.split())


def _failures(job: Any) -> list[str]:
    """The error of a job that has ended, in one line, if there is one."""
    error = job.exception()
    if error is None:
        return []
    # submitit puts the traceback between two rules
    _, _, after = str(error).partition("\nTraceback ")
    lines = [line for line in after.partition("\n----")[0].splitlines() if line[:1].strip()]
    return [(lines or str(error).splitlines() or [type(error).__name__])[-1]]
