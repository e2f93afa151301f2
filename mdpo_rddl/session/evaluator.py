"""Plays the policies of one session on the exact environment."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import Evaluation, evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.session.requests import EvaluationTerms, Reporter


@dataclass
class Evaluator:
    """Evaluates parameters of one planner on the given terms, and reports each episode."""

    terms: EvaluationTerms
    planner: MDPOPlanner
    policy_hyperparams: Mapping[str, Any]
    reporter: Reporter
    _done: int = field(default=0, init=False)

    def run(self, params: Any) -> Evaluation:
        """Plays the policy with these parameters."""
        self._done = 0
        env = make_environment(self.terms.problem)
        policy = playable(self.planner, params, self.policy_hyperparams, self.terms.seed)
        return evaluate(env, policy, self.terms.episodes, self.terms.seed, self._count)

    def _count(self) -> None:
        self._done += 1
        self.reporter.episode(self._done, self.terms.episodes)
