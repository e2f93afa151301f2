"""The underlying Markov decision process of a problem whose state is observed in part only."""

import dataclasses
import re

from mdpo_rddl.problem.files import COMMENT
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.source import ProblemSource


def underlying_mdp(problem: Problem) -> Problem:
    """The same problem without its observation fluents: whoever plays it sees the state.

    Args:
      problem: whose state is observed in part only.

    Raises:
      InputError: if the domain is no problem without them.
    """
    text = COMMENT.sub("", problem.domain_text)
    for name in problem.model.observ_fluents:
        head = rf"(?<![\w'-]){re.escape(name)}\s*(\([^)]*\))?\s*"
        text = re.sub(head + r":\s*\{\s*observ-fluent[^}]*\}\s*;", "", text)
        text = re.sub(head + r"=(?![=>])[^;]*;", "", text)
    return dataclasses.replace(ProblemSource.of(problem), domain_text=text).load()
