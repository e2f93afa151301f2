"""The paper's six settings: IPC 2023 instances 4 and 5 of three domains, horizon 120."""

from pathlib import Path

from mdpo_rddl.bench.common.names import DOMAIN_FILES
from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.load import Problem, load_problem


def setting_files(name: str, root: Path = Path()) -> tuple[str, str]:
    """Domain and instance file of a setting, in the folders `domains` and `instances`.

    Raises:
      InputError: if there is no such setting.
    """
    if name not in DOMAIN_FILES:
        raise InputError(f"unknown setting {name!r}, known are {', '.join(DOMAIN_FILES)}")
    domain = root / "domains" / DOMAIN_FILES[name]
    return str(domain), str(root / "instances" / f"{name}.rddl")


def load_setting(name: str, root: Path = Path()) -> Problem:
    """Loads one setting from the folders `domains` and `instances` under `root`.

    Raises:
      InputError: if there is no such setting or its files are missing.
    """
    return load_problem(*setting_files(name, root))
