"""The planners by their names."""

import pkgutil
from collections.abc import Callable
from functools import partial

from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc.jaxplan import JaxPlanPlanner
from mdpo_rddl.ipc.mdpo import MDPO
from mdpo_rddl.ipc.names import check_name
from mdpo_rddl.ipc.noop_player import NoopPlayer
from mdpo_rddl.ipc.planner import Planner
from mdpo_rddl.ipc.random_player import RandomPlayer
from mdpo_rddl.ipc.thinking import ThinkingMDPO

PLANNERS: dict[str, Callable[[], Planner]] = {
    "mdpo": MDPO,
    "mdpo-thinking": ThinkingMDPO,
    "jaxplan-slp": partial(JaxPlanPlanner, "slp"),
    "jaxplan-drp": partial(JaxPlanPlanner, "drp"),
    "noop": NoopPlayer,
    "random": RandomPlayer,
}
"""In the order of `mdpo_rddl.ipc.names.PLANNER_NAMES`."""


def make_planner(name: str) -> Planner:
    """A fresh planner.

    Args:
      name: a key of `PLANNERS`, or "module:Class" of someone else's.

    Raises:
      InputError: naming it, if there is none of that name or its class cannot be used.
    """
    return _class(name)()


def check_planner(name: str) -> None:
    """Looks a planner up without making one.

    Raises:
      InputError: as `make_planner` does.
    """
    _class(name)


def _class(name: str) -> Callable[[], Planner]:
    if name in PLANNERS:
        return PLANNERS[name]
    check_name(name)
    try:
        found = pkgutil.resolve_name(name)
    except (Exception, SystemExit) as error:  # whatever the module raises when it is imported
        cause = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"planner {name!r} cannot be loaded: {cause}") from error
    for method in ("prepare", "act"):
        if not callable(getattr(found, method, None)):
            raise InputError(f"planner {name!r} has no method {method!r}")
    return found
