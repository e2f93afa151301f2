"""What draws the states of a problem: the domain's own visualizer, or charts of its fluents."""

import logging
from collections.abc import Callable
from pathlib import Path

from PIL.Image import Image
from pyRDDLGym import RDDLEnv

from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.repository import rddl_repository

logger = logging.getLogger(__name__)

_CHARTS = {"figure_size": (7, 6)}


def drawing(problem: Problem, env: RDDLEnv) -> Callable[[], Image]:
    """What draws the present state of an environment, without a screen.

    Args:
      problem: whose domain's visualizer is used if rddlrepository has one.
      env: of the problem; its visualizer is replaced.
    """
    own = _own_visualizer(problem)
    if own is not None:
        try:
            env.set_visualizer(own)
            env.render(to_display=False)
        except Exception as error:  # it is whoever's code
            cause = " ".join(f"{type(error).__name__}: {error}".split())
            logger.warning("%s draws nothing here (%s): charts instead", own.__name__, cause)
            own = None
    if own is None:
        env.set_visualizer("chart", **_CHARTS)
    return lambda: env.render(to_display=False)


def _own_visualizer(problem: Problem) -> type | None:
    manager, name = rddl_repository(), problem.label.rpartition("-")[0]
    if name not in manager.list_problems():
        return None
    info = manager.get_problem(name)
    if Path(info.get_domain()) != problem.domain_path:
        return None
    try:
        return info.get_visualizer()
    except Exception as error:  # what it imports may be missing
        logger.warning("the visualizer of %s cannot be used: %s: charts instead", name, error)
        return None
