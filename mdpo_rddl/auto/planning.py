"""From a problem to a policy: by the race, and by a vote where the state is observed in part."""

from mdpo_rddl.auto.hidden.partially_observed import plan_partially_observed
from mdpo_rddl.auto.outcome.outcome import RaceOutcome
from mdpo_rddl.auto.race.options import RaceOptions
from mdpo_rddl.auto.race.race import run_race
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.problem.enumeration.model import require_actions, require_legal_start
from mdpo_rddl.problem.load import Problem


def plan_automatically(
    problem: Problem, config: PlannerConfig, seed: int, options: RaceOptions | None = None
) -> RaceOutcome:
    """Finds a policy.

    Args:
      problem: the parsed problem.
      config: with a `FeedbackPlan` and a section `[Search]`; `[Optimize] train_seconds` is
        the time for everything, compilation included.
      seed: of everything that is drawn.
      options: see `RaceOptions`.

    Raises:
      InputError: if there is no action, or none that is legal at the start, or JaxPlan refuses the
        problem or the configuration.
      KeyboardInterrupt: if interrupted before there was any policy.
    """
    require_actions(problem)
    require_legal_start(problem)
    options = RaceOptions() if options is None else options
    plan = plan_partially_observed if problem.model.observ_fluents else run_race
    return plan(problem, config, seed, options)
