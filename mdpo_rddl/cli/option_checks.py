"""Options of `mdpo-plan` that do not go together, and what they say together."""

import argparse

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.preset_names import DEFAULT_PRESET, PLAIN_PRESET

PLAIN_ONLY = [
    "noise",
    "sigma",
    "sigma_min",
    "sigma_max",
    "alpha",
    "quantile",
    "policy",
    "weight",
    "iterations",
    "restarts",
    "batch",
    "lookahead",
    "replan",
]
"""Options for one training with one policy, which the preset `auto` makes many of."""


TRAINING_ONLY = [*(name for name in PLAIN_ONLY if name != "replan"), "seconds"]
"""Options that make no sense for a policy that is loaded."""

_NOISE_NUMBERS = {
    "sigma": "constant",
    "sigma_min": "adaptive",
    "sigma_max": "adaptive",
    "alpha": "adaptive",
    "quantile": "adaptive",
}


def any_noise_number(options: argparse.Namespace) -> bool:
    """Whether one of the noise's numbers was given, for whichever rule."""
    return any(getattr(options, name) is not None for name in _NOISE_NUMBERS)


def noise_numbers(options: argparse.Namespace, noise: str) -> dict[str, float]:
    """The noise's numbers that were given.

    Args:
      options: what `plan_parser` parsed.
      noise: the rule that they are for: "adaptive", "constant" or "none".

    Raises:
      InputError: if one of them belongs to another rule.
    """
    given = {name: getattr(options, name) for name in _NOISE_NUMBERS}
    given = {name: value for name, value in given.items() if value is not None}
    for name in given:
        if _NOISE_NUMBERS[name] != noise:
            raise InputError(f"{option_name(name)} needs --noise {_NOISE_NUMBERS[name]}")
    return given


def preset_name(options: argparse.Namespace) -> str:
    """The preset that was asked for, or the one that the other options suppose.

    Raises:
      InputError: if an option does not go with the preset that was asked for.
    """
    given = [name for name in PLAIN_ONLY if getattr(options, name) not in (None, False)]
    if options.preset is None:
        return PLAIN_PRESET if given else DEFAULT_PRESET
    if options.preset == DEFAULT_PRESET and given:
        name = option_name(given[0])
        raise InputError(f"{name} does not go with --preset {DEFAULT_PRESET}, which chooses it")
    return str(options.preset)


def replans(options: argparse.Namespace) -> bool:
    """Whether every decision is planned anew, by the option or by the configuration."""
    return bool(options.replan) or str(options.config) == "replan"


def check_plan_options(options: argparse.Namespace) -> None:
    """Finds the mistakes that the options show by themselves.

    Raises:
      InputError: naming the option, if it does not go with another one.
    """
    if options.domain is None and options.load is None:
        raise InputError("which problem? Such as: mdpo-plan hvac10; mdpo-plan --list shows all")
    is_online = replans(options)
    if is_online and options.decision_seconds:
        raise InputError("--decision-seconds does not go with --replan, whose time is --seconds")
    _check_files(options)
    _check_resume(options)
    if options.load is not None:
        for name in TRAINING_ONLY:
            if getattr(options, name) is not None:
                raise InputError(
                    f"{option_name(name)} does not go with --load, which trains nothing"
                )
        if options.replan:
            raise InputError("--replan does not go with --load, which plans nothing")
    elif options.config is None:
        preset_name(options)
        noise_numbers(options, options.noise or "adaptive")
    elif options.noise is not None:
        noise_numbers(options, options.noise)


def _check_files(options: argparse.Namespace) -> None:
    for name in ("start_from", "movie"):
        if replans(options) and getattr(options, name) is not None:
            raise InputError(f"{option_name(name)} does not go with --replan, which plans anew")
    if options.load is not None and options.start_from is not None:
        raise InputError("--start-from does not go with --load, which plans nothing")
    if options.movie is not None and options.movie.suffix not in (".gif", ".mp4"):
        raise InputError(f"{options.movie}: a movie ends with .gif or .mp4")


def _check_resume(options: argparse.Namespace) -> None:
    if not options.resume:
        return
    if options.out is None:
        raise InputError("--resume needs the --out of the run that was stopped")
    if options.load is not None or replans(options):
        raise InputError("--resume goes with planning once, not with --load or --replan")


def option_name(attribute: str) -> str:
    """How the user writes an option."""
    return "--" + attribute.replace("_", "-")
