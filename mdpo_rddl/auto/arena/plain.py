"""JaxPlan's own classes of policies as planners of ours, each made once for all arms."""

from collections.abc import Collection

from mdpo_rddl.auto.probing.fitting import with_single_rollouts
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets.by_domain import config_for_domain
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.problem.load import Problem

STRAIGHT_LINE, REACTIVE = "slp", "drp"
METHODS = (STRAIGHT_LINE, REACTIVE)
"""As the configurations that come with JaxPlan call them."""

_CALL = {"iterations_per_call": 100, "test_every": 20}
# instead of a straight-line plan's RMSProp, which has no momentum: more return in as many seconds
# on 11 of 12 problems (results/plan_optimisers); its steps shrink where nothing is gained
_REPLACED, _ADAM, _LARGER = "rmsprop", {"b2": 0.95}, 2.0


class PlainPlanners:
    """Planners of straight-line plans ("slp") and of deep reactive policies ("drp")."""

    def __init__(self, problem: Problem, single: Collection[str] = ()) -> None:
        """Makes none yet.

        Args:
          problem: the parsed problem.
          single: methods for which one rollout shows what a policy returns.
        """
        self._problem, self._single = problem, single
        self._built: dict[str, Built[MDPOPlanner]] = {}

    def built(self, method: str) -> Built[MDPOPlanner]:
        """The planner of a method; nothing of it is compiled before it is used.

        Args:
          method: out of `METHODS`.

        Raises:
          InputError: if JaxPlan refuses the problem.
        """
        if method not in self._built:
            self._built[method] = build_planner(self._problem, self.config(method))
        return self._built[method]

    def config(self, method: str) -> PlannerConfig:
        """The configuration for the domain, in calls of many iterations.

        Noise on the actions would double what must be compiled, and parameter noise (PGPE)
        excludes calls; it is an arm of its own.
        """
        # a problem of rddlrepository is labelled by its name there and its instance
        name = self._problem.label.rpartition("-")[0]
        config = config_for_domain(name, self._problem.domain_name, method)
        config = config.without_noise()
        config = config.with_values("Planner", pgpe=None)
        if method == STRAIGHT_LINE:
            config = _with_momentum(config)
        if method in self._single:
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
