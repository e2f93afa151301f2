"""Plays the policies of one session on the exact environment."""

from dataclasses import dataclass, field

from mdpo_rddl.problem.evaluation import Evaluation, Policy, evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.session.requests import EvaluationTerms, Reporter


@dataclass
class Evaluator:
    """Evaluates policies on the given terms, and reports each episode."""

    terms: EvaluationTerms
    reporter: Reporter
    _done: int = field(default=0, init=False)

    def run(self, policy: Policy) -> Evaluation:
        """Plays a policy."""
        self._done = 0
        env = make_environment(self.terms.problem)
        return evaluate(env, policy, self.terms.episodes, self.terms.seed, self._count)

    def _count(self) -> None:
        self._done += 1
        self.reporter.episode(self._done, self.terms.episodes)
