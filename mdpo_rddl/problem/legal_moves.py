"""Legal actions for a planner that has nothing but the observed state."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mdpo_rddl.problem.episode import Verdict
from mdpo_rddl.problem.legality import Referee
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.problem.observation import as_numbers, is_observed


class LegalMoves:
    """Checks actions in an environment of its own, put into the observed state.

    Under partial observability, preconditions on what is not observed are checked in the
    instance's initial state.
    """

    def __init__(self, problem: Problem) -> None:
        """Makes the environment."""
        self.env = make_environment(problem)
        self.env.reset(seed=0)
        self._referee = Referee(self.env)

    def rule(self, proposal: Mapping[str, Any], state: Mapping[str, Any]) -> Verdict:
        """The proposal if it is legal in the state, else a legal action near it.

        See `mdpo_rddl.problem.legality.Referee.rule`.
        """
        self._go_to(state)
        return self._referee.rule(proposal)

    def rounded(self, proposal: Mapping[str, Any], state: Mapping[str, Any]) -> Mapping[str, Any]:
        """The proposal with what rounding has cost it given back, if it is legal then.

        See `mdpo_rddl.problem.feasibility`.
        """
        self._go_to(state)
        verdict = self._referee.rule(proposal)
        return proposal if verdict.illegal else verdict.actions

    def _go_to(self, state: Mapping[str, Any]) -> None:
        """Puts the environment into a state, as far as it is observed."""
        model, subs = self.env.model, self.env.sampler.subs
        for name, value in state.items():
            if not is_observed(value):
                continue
            numbers = as_numbers(model, name, value)
            subs[name] = np.reshape(numbers, np.shape(subs[name]))
