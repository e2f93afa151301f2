"""The configurations that are tried for the IPC 2023 domains."""

from typing import Any

from benchmarks.configs.names import SCALES
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.jaxplan_configs import jaxplan_config

MANY = 1_000_000
"""Iterations: only the time ends a training."""

_SHIPPED_SECONDS = 60


def candidates(domain: str, plan: str) -> dict[str, PlannerConfig]:
    """The configurations that are tried, by name.

    All start from JaxPlan's own for the domain, or its default; none counts rewards after
    termination.

    Args:
      domain: a key of `SCALES`.
      plan: one of `PLANS`.
    """
    own = jaxplan_config(f"{domain}_ippc2023", plan)
    budget = {"epochs": MANY, "train_seconds": _SHIPPED_SECONDS}
    base = own.with_values("Optimize", **budget).with_section("MDPO", {"stop_at_termination": True})
    still = base.with_section("Noise", {"method": "NoNoise"})

    def noisy(share: float, faster: float = 1.0, batch: int | None = None) -> PlannerConfig:
        noise = {"method": "AdaptiveNoise", "sigma_max": share * SCALES[domain]}
        config = base.with_values("Planner", pgpe=None).with_section("Noise", noise)
        rate = faster * base.optimizer_arguments["learning_rate"]
        config = config.with_optimizer_arguments(learning_rate=rate)
        if batch is not None:
            sizes = {"batch_size_train": batch, "batch_size_test": batch}
            config = config.with_values("Planner", **sizes)
        return config

    def in_calls(config: PlannerConfig) -> PlannerConfig:
        # a test after every tenth iteration can be a better one
        config = config.with_values("Planner", batch_size_test=16)
        config = config.with_values("Optimize", test_rolling_window=5)
        return config.with_values("MDPO", iterations_per_call=50, test_every=10)

    def with_net(config: PlannerConfig, **arguments: Any) -> PlannerConfig:
        return config.with_policy_arguments(**arguments)

    found = {
        "jaxplan": still,
        "no-pgpe": still.with_values("Planner", pgpe=None),
        "low": noisy(0.1),
        "high": noisy(1.0),
        "low-fast": noisy(0.1, faster=10.0),
        "low-fast-batch4": noisy(0.1, faster=10.0, batch=4),
        "pgpe-low": base.with_section("Noise", noisy(0.1).section("Noise")),
        "normalised": still.with_values("Planner", preprocessor="StaticNormalizer"),
        "calls-low-fast": in_calls(noisy(0.1, faster=10.0, batch=4)),
        "calls-high-fast": in_calls(noisy(1.0, faster=10.0, batch=4)),
        "calls-low": in_calls(noisy(0.1, faster=3.0, batch=4)),
    }
    if plan == "drp":
        found["calls-normed"] = with_net(found["calls-low-fast"], normalize=True)
        faster = in_calls(noisy(0.1, faster=30.0, batch=4))
        found["calls-squashed"] = with_net(faster, normalize=True, wrap_non_bool=True)
    return found
