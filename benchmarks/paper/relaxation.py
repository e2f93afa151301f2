"""How relaxed a model is: the weight, and whether its values are relaxed or only its gradients."""

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.values import compiler_parameters, relaxation_weights


def with_relaxation(config: PlannerConfig, weight: float, values_too: bool) -> PlannerConfig:
    """The configuration with another relaxation.

    Args:
      config: any configuration.
      weight: of all relaxations; larger is closer to exact.
      values_too: whether the relaxation changes values; JaxPlan's straight-through estimators
        use it for gradients only.
    """
    compiler = config.compiler_class()
    weights = dict.fromkeys(sorted(relaxation_weights(compiler)), weight)
    if not values_too:
        return config.with_values("Compiler", **weights)
    estimators = [name for name in sorted(compiler_parameters(compiler)) if name.endswith("_ste")]
    return config.with_values("Compiler", **weights, **dict.fromkeys(estimators, False))
