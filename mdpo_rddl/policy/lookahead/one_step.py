"""What methods have in common that change one action only."""

from dataclasses import dataclass

import numpy as np


@dataclass
class OneStep:
    """Keeps nothing from decision to decision."""

    depth: int = 1
    climbs: bool = False
    is_for_chance: bool = True

    def shift(self, chosen: np.ndarray) -> None:
        """Nothing is known for the next step."""

    def reset(self) -> None:
        """Nothing is known for the next episode."""

    def resume(self, changes: np.ndarray) -> None:
        """Plans of several steps are not made."""
