"""All kinds of policies, which are played and saved alike."""

from mdpo_rddl.policy.file import AnySaved, SavedPlanRule, SavedTable, problem_played
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.load import Problem

AnyPolicy = Policy | TablePolicy | RelaxedPlanPolicy
"""Called with a step and an observation; has a `problem`, a `seed` and `to_saved`."""


def restored(saved: AnySaved, problem: Problem, source: str) -> AnyPolicy:
    """The policy that was saved, ready to be played.

    Args:
      saved: as `mdpo_rddl.policy.file.load_policy` reads it.
      problem: on which to play it.
      source: where it came from, for error messages.

    Raises:
      InputError: if it does not fit the problem.
    """
    problem = problem_played(saved, problem)
    if isinstance(saved, SavedTable):
        return TablePolicy.from_saved(saved, problem, source)
    if isinstance(saved, SavedPlanRule):
        return RelaxedPlanPolicy.from_saved(saved, problem, source)
    return Policy.from_saved(saved, problem, source)
