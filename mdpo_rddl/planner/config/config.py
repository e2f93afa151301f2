"""JaxPlan's `.cfg` files, with three optional sections.

The format is JaxPlan's: sections `[Compiler]`, `[Planner]`, `[Optimize]`, each value a
Python literal. `[Noise]` names a rule of `mdpo_rddl.noise` as its `method` and that rule's
numbers; `[MDPO]` holds the switches of `MDPOPlanner`, and `[Search]` the shares of the race's
time. JaxPlan itself ignores them, so one file serves both planners.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import decoded, read_bounded
from mdpo_rddl.planner.config.budgets import JAXPLAN_BATCH, JAXPLAN_EPOCHS, JAXPLAN_SECONDS, Budget
from mdpo_rddl.planner.config.noise_section import rule_values
from mdpo_rddl.planner.config.text import (
    DEFAULT_COMPILER,
    JAXPLAN_SECTIONS,
    SECTIONS,
    format_sections,
    one_line,
    parse_sections,
)

if TYPE_CHECKING:  # a configuration is written without JAX, and checked with it
    from mdpo_rddl.noise import ActionNoise

_MOST_BYTES = 2**20

JaxPlanArguments = tuple[dict[str, Any], dict[str, Any], dict[str, Any]]


@dataclasses.dataclass(frozen=True)
class PlannerConfig:
    """The contents of one configuration file: copies, values by name, and what they make.

    Attributes:
      sections: per section, its keys and literal values.
      source: where it came from, for error messages.
    """

    sections: Mapping[str, Mapping[str, Any]]
    source: str

    @classmethod
    def from_file(cls, path: str | Path) -> "PlannerConfig":
        """Reads a file.

        Raises:
          InputError: if it cannot be read, or as `from_text` does.
        """
        try:
            text = decoded(read_bounded(Path(path), _MOST_BYTES))
        except (OSError, ValueError) as error:  # not UTF-8, or a name with a null character
            reason = getattr(error, "strerror", None) or "not a UTF-8 text file"
            raise InputError(f"{path}: cannot read the configuration: {reason}") from error
        return cls.from_text(text, str(path))

    @classmethod
    def from_text(cls, text: str, source: str = "configuration") -> "PlannerConfig":
        """Parses and checks a configuration.

        Raises:
          InputError: naming source, section and key, if the text is not a configuration, a
            section or key is unknown, a value is not a literal, or a name or number is one
            that neither JaxPlan nor the noise rule accepts.
        """
        return cls(parse_sections(text, source), source).checked()

    def checked(self) -> "PlannerConfig":
        """The configuration, if JaxPlan, the noise rule and the planner accept it.

        Raises:
          InputError: as `from_text` does.
        """
        from mdpo_rddl.planner.config.checks import check_sections

        check_sections(self.sections, self.source)
        return self

    def section(self, name: str) -> dict[str, Any]:
        """A copy of one section; empty if there is none."""
        return dict(self.sections.get(name, {}))

    def with_section(self, name: str, values: Mapping[str, Any]) -> "PlannerConfig":
        """A copy in which one section is replaced; what a user has chosen is still to check."""
        return dataclasses.replace(self, sections={**self.sections, name: dict(values)})

    def without_section(self, name: str) -> "PlannerConfig":
        """A copy without one of the optional sections."""
        rest = {key: self.sections[key] for key in self.sections if key != name}
        return dataclasses.replace(self, sections=rest)

    def with_values(self, name: str, **values: Any) -> "PlannerConfig":
        """A copy in which some keys of one section are set; see `with_section`."""
        return self.with_section(name, {**self.section(name), **values})

    def without_values(self, name: str, *keys: str) -> "PlannerConfig":
        """A copy in which some keys of one section are not given."""
        values = self.section(name)
        return self.with_section(name, {key: values[key] for key in values if key not in keys})

    def without_noise(self) -> "PlannerConfig":
        """The configuration of a planner without noise on the actions."""
        return self.with_section("Noise", {"method": "NoNoise"})

    def with_policy_arguments(self, **values: Any) -> "PlannerConfig":
        """`with_values` for some arguments of the policy; the others stay."""
        return self.with_values("Planner", method_kwargs={**self.policy_arguments, **values})

    def with_optimizer_arguments(self, **values: Any) -> "PlannerConfig":
        """`with_values` for some arguments of the optimiser; the others stay."""
        return self.with_values("Planner", optimizer_kwargs={**self.optimizer_arguments, **values})

    @property
    def key(self) -> int:
        """The seed of training; 0 where none is given."""
        return self.section("Optimize").get("key") or 0

    def budget(self, seconds: float = JAXPLAN_SECONDS) -> Budget:
        """Iterations and seconds of training; JaxPlan's and `seconds` where none are given."""
        values = self.section("Optimize")
        return Budget(values.get("epochs", JAXPLAN_EPOCHS), values.get("train_seconds", seconds))

    @property
    def batch_size(self) -> int:
        """Training rollouts of one iteration; JaxPlan's where none are given."""
        return self.section("Planner").get("batch_size_train", JAXPLAN_BATCH)

    @property
    def policy_method(self) -> str:
        """The name of the class of plan."""
        return self.section("Planner")["method"]

    @property
    def policy_arguments(self) -> dict[str, Any]:
        """What the plan is made with."""
        return dict(self.section("Planner").get("method_kwargs") or {})

    @property
    def optimizer_arguments(self) -> dict[str, Any]:
        """What the optimiser is made with."""
        return dict(self.section("Planner").get("optimizer_kwargs") or {})

    @property
    def noise_numbers(self) -> dict[str, float]:
        """The numbers of the noise rule that are given."""
        return {key: value for key, value in self.section("Noise").items() if key != "method"}

    def to_text(self, for_jaxplan: bool = False) -> str:
        """The text that `from_text` reads back; without our own sections if `for_jaxplan`."""
        return format_sections(self.sections, JAXPLAN_SECTIONS if for_jaxplan else SECTIONS)

    def noise(self) -> "ActionNoise":
        """The noise rule that `[Noise]` describes; the planner's default without the section."""
        from mdpo_rddl import noise as noise_rules

        if "Noise" not in self.sections:
            return noise_rules.default_noise()
        values = rule_values(self.section("Noise"))
        return getattr(noise_rules, values.pop("method"))(**values)

    def jaxplan_arguments(self) -> JaxPlanArguments:
        """JaxPlan's triple: the planner's, the plan's and `optimize`'s keyword arguments.

        Raises:
          InputError: if JaxPlan refuses the values.
        """
        from mdpo_rddl.planner.config.extensions import stand_ins
        from mdpo_rddl.planner.upstream import planner

        try:
            section, ours = stand_ins(self.section("Planner"))
            known = dataclasses.replace(self, sections={**self.sections, "Planner": section})
            loaded = planner.load_config_from_string(known.to_text(for_jaxplan=True))
        except Exception as error:  # JaxPlan raises whatever the values make Python raise
            raise InputError(f"{self.source}: JaxPlan refuses it: {one_line(error)}") from error
        planner_args, plan_args, train_args = loaded
        return {**planner_args, **ours}, plan_args, train_args

    def mdpo_arguments(self) -> dict[str, Any]:
        """What `MDPOPlanner` takes beside JaxPlan's arguments: the switches and any noise."""
        noise = {"configured_noise": self.noise()} if "Noise" in self.sections else {}
        return {**noise, **self.section("MDPO")}

    def compiler_class(self) -> type:
        """The class that compiles the relaxed model."""
        from mdpo_rddl.planner.upstream import logic

        return getattr(logic, self.section("Compiler").get("method", DEFAULT_COMPILER))


def load_config(path: str | Path) -> JaxPlanArguments:
    """JaxPlan's `load_config`, with `[Noise]` and `[MDPO]` read into the planner's arguments.

    Returns:
      The keyword arguments of `MDPOPlanner`, of its plan, and of `optimize`. The rule of a section
      `[Noise]` is `configured_noise`, over which a `noise` wins.

    Raises:
      InputError: naming file, section and key.
    """
    return _arguments(PlannerConfig.from_file(path))


def load_config_from_string(value: str) -> JaxPlanArguments:
    """As `load_config`, from the file's contents."""
    return _arguments(PlannerConfig.from_text(value))


def _arguments(config: PlannerConfig) -> JaxPlanArguments:
    planner_args, plan_args, train_args = config.jaxplan_arguments()
    return {**planner_args, **config.mdpo_arguments()}, plan_args, train_args
