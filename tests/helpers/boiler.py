"""The boiler: the environment fails once the pressure is above 2."""

import dataclasses

from helpers.toys import toy
from mdpo_rddl.problem.load import Problem


def boiler(
    hiss: str = "Bernoulli(0.75)",
    reward: str = "sum_{?p : pressure} [VALUE(?p) * at(?p)]",
    raises: bool = True,
) -> Problem:
    """The problem, by what is heard and paid, and by whether a race has seen it fail."""
    return dataclasses.replace(toy("boiler", HISS=hiss, REWARD=reward), raises=raises)
