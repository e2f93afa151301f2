"""Which configuration a name, a file or a preset stands for."""

from pathlib import Path

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import DEFAULT_PRESET, PRESETS


def load_preset(preset: str = DEFAULT_PRESET, domain_name: str = "") -> PlannerConfig:
    """The configuration of a preset, to be changed and handed to `mdpo_rddl.plan`.

    Args:
      preset: "auto", the race, or "paper".
      domain_name: as the RDDL file names it (`Problem.domain_name`); "paper" has noise of their own
        for the paper's domains.

    Raises:
      InputError: if there is no such preset.
    """
    if preset not in PRESETS:
        raise InputError(f"there is no preset {preset!r}, only {', '.join(PRESETS)}")
    return PRESETS[preset](domain_name)


def config_of_file(given: str | Path, domain: str, domain_name: str) -> tuple[str, PlannerConfig]:
    """The configuration of a file, or of a method: the one for the domain.

    Args:
      given: a file, or "drp", "slp" or "replan".
      domain: how the user named the domain: a problem of rddlrepository, or a file.
      domain_name: how the RDDL file names it.

    Returns:
      What to call it, and the configuration.

    Raises:
      InputError: if the file cannot be read or used.
    """
    # imports JAX
    from mdpo_rddl.planner.config.presets.by_domain import METHODS, config_for_domain

    if str(given) in METHODS:
        # as JaxPlan's third argument: the domain's own configuration
        config = config_for_domain(domain, domain_name, str(given))
        return config.source, config
    return str(given), PlannerConfig.from_file(Path(given))
