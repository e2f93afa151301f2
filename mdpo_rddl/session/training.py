"""Find a policy by one training."""

import logging
import time

import jax

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan
from mdpo_rddl.planner.training.checkpoints import Checkpoints
from mdpo_rddl.planner.training.training import Progress, TrainingResult, train
from mdpo_rddl.planner.upstream import JaxStraightLinePlan
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.problem.enumeration.model import require_legal_start
from mdpo_rddl.problem.functions import FunctionError
from mdpo_rddl.session.preparation import preparing
from mdpo_rddl.session.requests import FindTerms, Reporter

logger = logging.getLogger(__name__)


def find_by_training(
    terms: FindTerms,
    reporter: Reporter,
    counts_compilation: bool = False,
    checkpoints: Checkpoints | None = None,
) -> tuple[Policy, TrainingResult]:
    """One training as the configuration has it.

    Args:
      terms: what to plan.
      reporter: is told how it gets on; what it raises as `Cancelled` ends it.
      counts_compilation: whether compilation is part of the configuration's time.
      checkpoints: where the training's state is left now and then.

    Raises:
      InputError: if the problem or the configuration cannot be used.
    """
    if terms.start_from is not None:
        raise InputError("a policy to start from goes with the preset auto only")
    require_legal_start(terms.problem)
    reporter.stage("compiling")
    built = build_planner(terms.problem, terms.config, terms.traced_cache)
    planner, seed = built.planner, terms.seed
    if isinstance(planner.plan, GreedyPlan):
        raise InputError(
            f"{terms.config.source}: [Planner] method: GreedyPlan has no gradient, only the race "
            "of the preset auto learns it"
        )
    steps, horizon = planner.horizon, terms.problem.horizon
    if isinstance(planner.plan, JaxStraightLinePlan) and steps < horizon:
        message = "the plan has %d steps, its last action is repeated up to the horizon %d"
        logger.warning(message, steps, horizon)
    began = time.monotonic()
    try:
        with preparing(planner, terms) as begin_preparing:

            def on_progress(progress: Progress) -> None:
                begin_preparing()
                reporter.training(progress)

            key = jax.random.PRNGKey(seed)
            result = train(
                built,
                key,
                counts_compilation=counts_compilation,
                on_progress=on_progress,
                checkpoints=checkpoints,
            )
    except FunctionError:  # which names its own file
        raise
    except InputError as error:
        raise InputError(
            f"{terms.problem.instance_path}: {error} (configured by {terms.config.source})"
        ) from error
    best = {
        "seconds": round(time.monotonic() - began, 3),
        "arm": "training",
        "candidate": f"iterate {result.best_iteration:,}",
        "mean_return": result.best_return,
        "error": None,
        "became_incumbent": True,
    }
    hyperparams, params = dict(result.policy_hyperparams), result.best_params
    own = params, hyperparams, seed, (best,)
    policy = Policy(terms.problem, terms.config, *own, compiled=Compiled(planner))
    return policy, result
