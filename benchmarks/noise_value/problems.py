"""The problems on which noise is measured by default."""

from pathlib import Path

from mdpo_rddl.machine.files import MOST_BYTES, read_bounded
from mdpo_rddl.problem.repository import named_instance, rddl_repository

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
      names: "Problem" or "Problem:instance" of rddlrepository. If None all of it, but for what has
        the same files as another problem (2014's competition used some of 2011's again).

    Raises:
      InputError: for an unknown problem or instance.
    """
    pairs = []
    for name in repository() if names is None else names:
        if name in IPPC2023:
            pairs += [(name, number) for number in INSTANCES_2023]
        else:
            pairs.append(named_instance(name))
    return pairs if names is not None else _without_repetitions(pairs)


def _without_repetitions(pairs: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """The first of those whose domain and instance files are equal."""
    distinct: dict[tuple[bytes, bytes], tuple[str, str]] = {}
    for name, instance in pairs:
        problem = rddl_repository().get_problem(name)
        files = problem.get_domain(), problem.get_instance(instance)
        domain, text = (read_bounded(Path(file), MOST_BYTES) for file in files)
        distinct.setdefault((domain, text), (name, instance))
    return list(distinct.values())


def repository() -> list[str]:
    """Names of all problems of rddlrepository."""
    return sorted(rddl_repository().list_problems())
