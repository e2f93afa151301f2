"""What the options of `mdpo-plan` change in a configuration."""

import argparse

from mdpo_rddl.cli.option_checks import any_noise_number, noise_numbers
from mdpo_rddl.errors import InputError
from mdpo_rddl.noise.units import RANGE
from mdpo_rddl.planner.config.budgets import DECISION_SECONDS, JAXPLAN_EPOCHS
from mdpo_rddl.planner.config.config import PlannerConfig


def configure(config: PlannerConfig, options: argparse.Namespace) -> PlannerConfig:
    """The configuration with the options applied to it.

    Args:
      config: what to start from.
      options: what `plan_parser` parsed.

    Raises:
      InputError: if an option does not go with the noise that was chosen, or a value is one
        that the configuration refuses.
    """
    given_config = config
    config = _configure_noise(config, options)
    policy = options.policy
    if options.replan and options.config is None:
        # a preset's budget is for one long training, and its policy for all states
        budget = {"epochs": JAXPLAN_EPOCHS, "train_seconds": DECISION_SECONDS}
        config = config.with_values("Optimize", **budget)
        policy = policy or "slp"
    if policy is not None:
        method = {"drp": "JaxDeepReactivePolicy", "slp": "JaxStraightLinePlan"}[policy]
        if config.policy_method != method:
            # one plan's arguments mean nothing to another
            config = config.with_values("Planner", method=method, method_kwargs={})
    if options.weight is not None:
        from mdpo_rddl.planner.config.values import relaxation_weights  # imports JAX

        names = sorted(relaxation_weights(config.compiler_class()))
        config = config.with_values("Compiler", **dict.fromkeys(names, options.weight))
    changes = {
        "Planner": {
            "parallel_updates": options.restarts,
            "batch_size_train": options.batch,
            "rollout_horizon": options.lookahead,
        },
        "Optimize": {"epochs": options.iterations, "train_seconds": options.seconds},
    }
    for section, values in changes.items():
        given = {key: value for key, value in values.items() if value is not None}
        config = config.with_values(section, **given)
    of_any_time = [
        each.with_values("Optimize", train_seconds=0.0) for each in (config, given_config)
    ]
    # a check imports JAX, which seconds are not worth
    return config if of_any_time[0] == of_any_time[1] else config.checked()


_NOISE_METHODS = {"adaptive": "AdaptiveNoise", "constant": "ConstantNoise", "none": "NoNoise"}


def _configure_noise(config: PlannerConfig, options: argparse.Namespace) -> PlannerConfig:
    values = config.section("Noise")
    if not values and options.noise is None and not any_noise_number(options):
        return config  # the planner's default
    if not values or "paired" in values:
        values.setdefault("unit", RANGE)  # as it is read
    values.setdefault("method", "AdaptiveNoise")
    if options.noise is not None and _NOISE_METHODS[options.noise] != values["method"]:
        unit = {"unit": values["unit"]} if "unit" in values and options.noise != "none" else {}
        values = {"method": _NOISE_METHODS[options.noise], **unit}
    names = {method: noise for noise, method in _NOISE_METHODS.items()}
    values |= noise_numbers(options, names.get(values["method"], values["method"]))
    lowest, highest = values.get("sigma_min"), values.get("sigma_max")
    if options.sigma_min is not None and highest is not None and lowest > highest:
        raise InputError(f"--sigma-min {lowest:g} is above sigma_max, {highest:g}: set --sigma-max")
    return config.with_section("Noise", values)
