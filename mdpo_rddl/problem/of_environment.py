"""The problem that a pyRDDLGym environment plays."""

import dataclasses
from typing import Any

from pyRDDLGym import RDDLEnv

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.files import read_problem
from mdpo_rddl.problem.load import Problem, parse_problem


def problem_of(env: Any) -> Problem:
    """Loads the problem of an environment from the files that it was made from.

    Args:
      env: an `RDDLEnv`, vectorized or not, also inside Gymnasium's wrappers. Its horizon is kept.

    Raises:
      InputError: if it is no such environment, or was made from a model and not from files.
    """
    inner = getattr(env, "unwrapped", env)
    if not isinstance(inner, RDDLEnv):
        raise InputError(
            "expected the names or files of a problem, a Problem or a pyRDDLGym environment, "
            f"got {type(env).__name__}"
        )
    # pyRDDLGym calls the paths texts
    domain, instance = inner.domain_text, inner.instance_text
    if not isinstance(domain, str) or not isinstance(instance, str):
        raise InputError(
            "the environment was made from a model, which has no files: give the Problem instead"
        )
    files = read_problem(domain, instance)
    # whoever made the environment has accepted the names in them
    files = dataclasses.replace(files, is_own=False)
    horizon = None if inner.horizon == inner.model.horizon else inner.horizon
    functions = getattr(inner.sampler, "python_functions", None)
    return parse_problem(files, horizon, functions=functions)
