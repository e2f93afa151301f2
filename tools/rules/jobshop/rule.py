"""An idle machine takes the job with most priority for its work there and half its work left."""

from collections.abc import Mapping
from typing import Any, NamedTuple


class Job(NamedTuple):
    """Its machines in their order, the chance to end there in a step, and its priority."""

    machines: tuple[int, ...]
    chances: tuple[float, ...]
    priority: float


JOBS = {
    "j1": Job((1, 2, 3, 4), (0.2, 0.25, 0.3, 0.5), 3.0),
    "j2": Job((2, 1, 4, 3), (0.5, 0.35, 0.4, 0.25), 4.0),
    "j3": Job((1, 3, 2, 4), (0.2, 0.4, 0.25, 0.5), 2.0),
    "j4": Job((3, 2, 1, 4), (0.3, 0.5, 0.5, 0.6), 1.0),
    "j5": Job((2, 4, 3, 1), (0.25, 0.2, 0.4, 0.3), 5.0),
    "j6": Job((1, 4, 2, 3), (0.6, 0.5, 0.4, 0.5), 1.5),
}
MACHINES = (1, 2, 3, 4)
REST = 0.5
"""What the work left counts, against the work here."""


def rate(job: Job, done: int) -> float:
    """The priority of a job for its expected work, after some of its operations."""
    work = [1 / chance for chance in job.chances[done:]]
    return job.priority / (work[0] + REST * sum(work))


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """The operations that start."""
    done = {name: int(state[f"done___{name}"]) for name in JOBS}
    open_jobs = [name for name in JOBS if done[name] < len(MACHINES)]
    actions = {}
    for machine in MACHINES:
        ready = [name for name in open_jobs if JOBS[name].machines[done[name]] == machine]
        is_busy = any(state[f"busy___{name}__m{machine}"] for name in JOBS)
        if ready and not is_busy:
            best = max(ready, key=lambda name: rate(JOBS[name], done[name]))
            actions[f"start___{best}__m{machine}"] = True
    return actions
