"""Where each fluent's values lie once they stand side by side in one vector."""

import itertools
import math
from collections.abc import Mapping


def places_of(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, slice]:
    """The slice of each fluent, in the order in which they are given.

    Args:
      shapes: per fluent that of its values; () for one without parameters, which has one.
    """
    ends = itertools.accumulate(map(math.prod, shapes.values()), initial=0)
    return {name: slice(*pair) for name, pair in zip(shapes, itertools.pairwise(ends), strict=True)}
