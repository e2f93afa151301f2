"""The problems on which noise is measured by default."""

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.repository import rddl_repository

INSTANCES_2023 = ("1", "2", "3", "4", "5")

IPPC2023 = (
    "HVAC_ippc2023",
    "MarsRover_ippc2023",
    "MountainCar_ippc2023",
    "PowerGen_ippc2023",
    "RaceCar_ippc2023",
    "RecSim_ippc2023",
    "Reservoir_ippc2023",
    "UAV_ippc2023",
)


def with_instances(names: list[str] | None) -> list[tuple[str, str]]:
    """Problems and their instances: all five of 2023's competition, else the first.

    Args:
      names: "Problem" or "Problem:instance" of rddlrepository; all of it if None.

    Raises:
      InputError: for an unknown problem.
    """
    from_repository = repository()
    pairs = []
    for name in from_repository if names is None else names:
        problem, colon, instance = name.partition(":")
        if problem not in from_repository:
            raise InputError(f"rddlrepository has no problem {problem!r}")
        if colon:
            pairs.append((problem, instance))
        elif problem in IPPC2023:
            pairs += [(problem, number) for number in INSTANCES_2023]
        else:
            pairs.append((problem, rddl_repository().get_problem(problem).list_instances()[0]))
    return pairs


def repository() -> list[str]:
    """Names of all problems of rddlrepository."""
    return sorted(rddl_repository().list_problems())
