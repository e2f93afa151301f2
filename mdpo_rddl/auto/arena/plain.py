"""JaxPlan's own straight-line plan as a planner of ours."""

from functools import cached_property

from mdpo_rddl.planner.config.fitting import with_single_rollouts
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets.by_domain import config_for_domain
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.problem.load import Problem

# as the configurations that come with JaxPlan call it
_METHOD = "slp"
_CALL = {"iterations_per_call": 100, "test_every": 20}
# instead of a straight-line plan's RMSProp, which has no momentum: more return in as many seconds
# on 11 of 12 problems (results/plan_optimisers); its steps shrink where nothing is gained
_REPLACED, _ADAM, _LARGER = "rmsprop", {"b2": 0.95}, 2.0


class StraightLine:
    """The planner of straight-line plans, made once it is asked for."""

    def __init__(self, problem: Problem, is_single: bool = False) -> None:
        """Makes none yet.

        Args:
          problem: the parsed problem.
          is_single: whether one rollout shows what a plan returns.
        """
        self._problem, self._is_single = problem, is_single

    @cached_property
    def built(self) -> Built[MDPOPlanner]:
        """The planner; nothing of it is compiled before it is used.

        Raises:
          InputError: if JaxPlan refuses the problem.
        """
        return build_planner(self._problem, self.config)

    @cached_property
    def config(self) -> PlannerConfig:
        """The configuration for the domain, in calls of many iterations.

        Noise on the actions would double what must be compiled, and parameter noise (PGPE)
        excludes calls.
        """
        # a problem of rddlrepository is labelled by its name there and its instance
        name = self._problem.label.rpartition("-")[0]
        config = config_for_domain(name, self._problem.domain_name, _METHOD)
        config = _with_momentum(config.without_noise().with_values("Planner", pgpe=None))
        if self._is_single:
            config = with_single_rollouts(config)
        return config.with_section("MDPO", {**_CALL, **config.section("MDPO")})


def _with_momentum(config: PlannerConfig) -> PlannerConfig:
    """The configuration with Adam in place of RMSProp, if that is all that it says of its steps."""
    planner = config.section("Planner")
    arguments = planner.get("optimizer_kwargs", {})
    if planner.get("optimizer") != _REPLACED or set(arguments) != {"learning_rate"}:
        return config
    rate = _LARGER * arguments["learning_rate"]
    return config.with_values(
        "Planner", optimizer="adam", optimizer_kwargs={"learning_rate": rate, **_ADAM}
    )
