"""The underlying Markov decision process of a problem whose state is observed in part only."""

import dataclasses
import re

import numpy as np

from mdpo_rddl.problem.errors_in_play import error_condition
from mdpo_rddl.problem.files import COMMENT
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.source import ProblemSource


def underlying_mdp(problem: Problem, error_cost: float = 0.0) -> Problem:
    """The same problem without its observation fluents: whoever plays it sees the state.

    Args:
      problem: whose state is observed in part only.
      error_cost: what is taken from the reward at each step at which the environment would raise an
        error; 0.0 if nothing is.

    Raises:
      InputError: if the domain is no problem without them.
      NoConditionError: if errors cost something and it is not known when there is one.
    """
    text = COMMENT.sub("", problem.domain_text)
    for name in problem.model.observ_fluents:
        head = rf"(?<![\w'-]){re.escape(name)}\s*(\([^)]*\))?\s*"
        text = re.sub(head + r":\s*\{\s*observ-fluent[^}]*\}\s*;", "", text)
        text = re.sub(head + r"=(?![=>])[^;]*;", "", text)
    if error_cost:
        cost = np.format_float_positional(error_cost, trim="0")
        charge = f"{cost} * ({error_condition(problem.model)})"
        text = re.sub(
            r"(?<![\w'-])reward\s*=(?![=>])([^;]*);",
            lambda found: f"reward = ({found[1]}) - {charge};",
            text,
        )
    loaded = dataclasses.replace(ProblemSource.of(problem), domain_text=text).load(
        functions=problem.functions
    )
    return dataclasses.replace(loaded, error_cost=error_cost)
