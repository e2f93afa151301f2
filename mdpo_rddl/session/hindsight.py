"""The entry `hindsight` of a run's summary: what knowing the future would add."""

from typing import Any

from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.session.requests import EvaluationTerms, Reporter

HINDSIGHT_SECONDS = 60.0
"""For the estimate and for the bounds."""
# more would leave a search little time for each
_MOST_EPISODES = 10


def hindsight_figures(
    policy: AnyPolicy, terms: EvaluationTerms, reporter: Reporter
) -> dict[str, Any]:
    """The entry, of the policy without thinking at its decisions.

    Args:
      policy: whose episodes they are.
      terms: of its evaluation, of whose episodes the first ones count.
      reporter: hears of the stage.
    """
    reporter.stage("hindsight")
    episodes = min(terms.episodes, _MOST_EPISODES)
    return {"hindsight": policy.hindsight(episodes, HINDSIGHT_SECONDS, terms.seed).to_json()}
