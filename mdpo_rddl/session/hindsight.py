"""The entry `hindsight` of a run's summary: what knowing the future would add."""

import logging
from typing import Any

from mdpo_rddl.errors import note_heard, one_line_cause
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.session.requests import EvaluationTerms, Reporter

logger = logging.getLogger(__name__)

HINDSIGHT_SECONDS = 60.0
"""For the estimate and for the bounds."""
# more would leave a search little time for each
_MOST_EPISODES = 10


def hindsight_figures(
    policy: AnyPolicy, terms: EvaluationTerms, reporter: Reporter
) -> dict[str, Any]:
    """The entry, of the policy without thinking at its decisions; nothing where that fails.

    Args:
      policy: whose episodes they are.
      terms: of its evaluation, of whose episodes the first ones count.
      reporter: hears of the stage.
    """
    reporter.stage("hindsight")
    episodes = min(terms.episodes, _MOST_EPISODES)
    try:
        found = policy.hindsight(episodes, HINDSIGHT_SECONDS, terms.seed)
    except KeyboardInterrupt as stop:
        note_heard(stop)
        logger.warning("no hindsight: stopped while it was worked out")
        return {}
    except Exception as error:  # which must not cost the run
        logger.warning("no hindsight: %s: %s", type(error).__name__, one_line_cause(error))
        return {}
    return {"hindsight": found.to_json()}
