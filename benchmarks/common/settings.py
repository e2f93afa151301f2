"""The paper's six settings: IPC 2023 instances 4 and 5 of three domains, horizon 120."""

from benchmarks.common.names import SETTINGS
from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.load import Problem, load_problem
from mdpo_rddl.problem.shipped import shipped_files


def setting_files(name: str) -> tuple[str, str]:
    """Domain and instance file of a setting.

    Raises:
      InputError: if there is no such setting.
    """
    if name not in SETTINGS:
        raise InputError(f"unknown setting {name!r}, known are {', '.join(SETTINGS)}")
    domain, instance = shipped_files(name)
    return str(domain), str(instance)


def load_setting(name: str) -> Problem:
    """Loads one setting.

    Raises:
      InputError: if there is no such setting.
    """
    return load_problem(*setting_files(name))
