"""How many cores there are to use."""

import os


def usable_cores() -> int:
    """How many cores this process may use."""
    # not every system tells which ones
    return len(getattr(os, "sched_getaffinity", lambda _: range(os.cpu_count() or 1))(0))
