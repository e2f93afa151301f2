"""How much memory a process has had."""

import resource
import sys


def peak_mb() -> float:
    """The largest resident memory that this process had up to now."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)
