"""Plays the policies of one session on the exact environment."""

from dataclasses import dataclass, field

from mdpo_rddl.problem.evaluation import Evaluation, Policy, evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.played import NotPlayedError, PlayedSimulator
from mdpo_rddl.session.observed import Observed
from mdpo_rddl.session.requests import EvaluationTerms, Reporter


@dataclass
class Evaluator:
    """Evaluates policies on the given terms, and reports each episode."""

    terms: EvaluationTerms
    reporter: Reporter
    _done: int = field(default=0, init=False)

    def run(self, policy: Policy, observed: Observed | None = None) -> Evaluation:
        """Plays a policy.

        Args:
          policy: what is played.
          observed: keeps how it plays.

        Raises:
          NotPlayedError: naming the files, if the environment fails.
        """
        self._done = 0
        terms, problem = self.terms, self.terms.problem
        env = make_environment(problem, backend=PlayedSimulator)
        recorder = None
        if observed is not None:
            policy = observed.watch(policy)
            recorder = observed.recorder
        try:
            return evaluate(env, policy, terms.episodes, terms.seed, self._count, recorder)
        except NotPlayedError as error:
            files = f"{problem.domain_path}, {problem.instance_path}"
            raise NotPlayedError(f"{files}: episode {self._done + 1}: {error}") from error

    def _count(self) -> None:
        self._done += 1
        self.reporter.episode(self._done, self.terms.episodes)
