"""The planners' names, for those who offer or sort them and import no JAX."""

from mdpo_rddl.errors import InputError

PLANNER_NAMES = ("mdpo", "mdpo-thinking", "jaxplan-slp", "jaxplan-drp", "noop", "random")
USUAL_NAMES = ("mdpo", "jaxplan-slp", "jaxplan-drp", "noop", "random")
"""Those that need but a small part of a trial's time."""

JAXPLAN = ("jaxplan-slp", "jaxplan-drp")
FLOOR = ("noop", "random")
"""The players that mark what 0 is worth."""


def check_name(name: str) -> None:
    """Raises `InputError` for what is neither one of `PLANNER_NAMES` nor a module:Class."""
    if name not in PLANNER_NAMES and name.count(":") != 1:
        known = f"known are {', '.join(PLANNER_NAMES)}, and any module:Class"
        raise InputError(f"unknown planner {name!r}, {known}")
