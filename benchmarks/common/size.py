"""How much of everything a measurement takes."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Size:
    """The size of one measurement.

    Attributes:
      seeds: number of seeds, from 0.
      iterations: of each training.
      episodes: of each seed on the exact numpy environment.
    """

    seeds: int
    iterations: int
    episodes: int
