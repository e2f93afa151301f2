"""The configurations that come with JaxPlan."""

import dataclasses
from pathlib import Path

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.upstream import planner

METHODS = ("drp", "slp", "replan")
_FOLDER = Path(planner.__file__).parent.parent / "examples" / "configs"


def jaxplan_config(domain: str, method: str) -> PlannerConfig:
    """What `jaxplan plan` reads: JaxPlan's file for a domain, else its default.

    Args:
      domain: a problem's name in rddlrepository.
      method: one of `METHODS`.
    """
    path = _FOLDER / f"{domain}_{method}.cfg"
    path = path if path.is_file() else _FOLDER / f"default_{method}.cfg"
    return dataclasses.replace(PlannerConfig.from_file(path), source=f"JaxPlan's {path.name}")
