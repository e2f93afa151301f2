"""Configurations by domain: ours where the project ships one, else JaxPlan's own.

Ours are in `mdpo_rddl/planner/config/shipped`, chosen by measurements (results/configs).
"""

from importlib import resources

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.jaxplan_configs import METHODS, jaxplan_config
from mdpo_rddl.problem.competition import REPOSITORY_NAMES
from mdpo_rddl.problem.files import looks_like_file

_FOLDER = resources.files("mdpo_rddl.planner.config") / "shipped"


def config_for_domain(given_name: str, domain_name: str, method: str) -> PlannerConfig:
    """The configuration for a domain, found by its name.

    Args:
      given_name: how the user named the domain: a problem of rddlrepository, or a file.
      domain_name: how the RDDL file names it.
      method: "drp", "slp" or "replan".

    Returns:
      Ours, else JaxPlan's for the domain, else JaxPlan's default for the method.
    """
    # a file has no name in rddlrepository; JaxPlan's for any problem is called "default"
    name = "default" if looks_like_file(given_name) else given_name
    known_name = REPOSITORY_NAMES.get(domain_name, name)
    for candidate in (name, known_name):
        file = _FOLDER / f"{candidate}_{method}.cfg"
        if file.is_file():
            text = file.read_text(encoding="utf-8")
            return PlannerConfig.from_text(text, f"shipped configuration {file.name}")
    return jaxplan_config(known_name, method)


__all__ = ["METHODS", "config_for_domain"]
