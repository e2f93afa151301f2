"""What single changes of an action have an effect on, and which can be tried together for it."""

from typing import NamedTuple

import numpy as np


class Effects(NamedTuple):
    """What D changes of an action affect among I numbers, each change alone.

    As the columns of a sparse Jacobian are found together that have no row in common (Curtis,
    Powell and Reid, "On the estimation of sparse Jacobian matrices", 1974), changes that affect
    nothing in common are made together: what each would have affected alone can be told apart.

    Attributes:
      together: C sets of changes [C, D].
      of_change: in which set each change is [D].
      places: the numbers that each change affects [D, K]; 0 beyond them.
      mask: which of `places` those are [D, K].
    """

    together: np.ndarray
    of_change: np.ndarray
    places: np.ndarray
    mask: np.ndarray

    @classmethod
    def of(cls, affects: np.ndarray) -> "Effects":
        """Puts each change into the first set with none of which it has an effect in common.

        Args:
          affects: which numbers each change affects [D, I].
        """
        size = len(affects)
        taken = np.zeros((0, affects.shape[1]), bool)
        of_change = np.zeros(size, int)
        for change, own in enumerate(affects):
            free = np.flatnonzero(~np.any(taken & own, axis=1))
            if not len(free):
                free, taken = np.array([len(taken)]), np.vstack([taken, np.zeros_like(own)])
            of_change[change] = free[0]
            taken[free[0]] |= own
        together = np.arange(len(taken))[:, np.newaxis] == of_change
        most = int(affects.sum(axis=1).max(initial=0))
        places = np.argsort(~affects, axis=1, kind="stable")[:, :most]
        mask = np.take_along_axis(affects, places, axis=1)
        return cls(together, of_change, np.where(mask, places, 0), mask)
