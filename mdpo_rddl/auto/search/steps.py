"""When a training makes smaller steps, and how much smaller."""

# of the iterations so far, and at least so many, without a better iterate
_WAITING_SHARE, _LEAST_ITERATIONS = 0.3, 500
_SHRINK, _SIZES = 0.3, 5


def has_stalled(iterations: int, best_iteration: int) -> bool:
    """Whether the steps of a phase are too large, or it has reached a local optimum.

    Args:
      iterations: of the phase so far.
      best_iteration: the one with the best return.
    """
    waited = iterations - best_iteration
    return waited > max(_LEAST_ITERATIONS, _WAITING_SHARE * iterations)


def step_factor(phase: int) -> float:
    """A phase's step size, as a share of the first one's.

    Steps shrink from phase to phase; after the smallest the first size comes again, which leads
    away from a local optimum.

    Args:
      phase: counted from 0.
    """
    return float(_SHRINK ** (phase % _SIZES))
