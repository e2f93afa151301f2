"""JaxPlan's `.cfg` files, with three optional sections.

The format is JaxPlan's: sections `[Compiler]`, `[Planner]`, `[Optimize]`, each value a
Python literal. `[Noise]` names a rule of `mdpo_rddl.noise` as its `method` and that rule's
numbers; `[MDPO]` holds the switches of `MDPOPlanner`. JaxPlan itself ignores both, so one
file serves both planners.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import optax

from mdpo_rddl import noise as noise_rules
from mdpo_rddl.errors import InputError
from mdpo_rddl.noise import ActionNoise
from mdpo_rddl.planner.config.extensions import OPTIMIZERS, PLANS, stand_ins
from mdpo_rddl.planner.config.noise_section import NOT_NUMBERS, rule_values
from mdpo_rddl.planner.config.search_section import Search
from mdpo_rddl.planner.config.text import one_line, parse_sections
from mdpo_rddl.planner.config.values import (
    compiler_parameters,
    concrete_class,
    is_number,
    parameters,
)
from mdpo_rddl.planner.upstream import (
    JaxBackpropPlanner,
    JaxOfflineController,
    JaxOnlineController,
    JaxPlan,
    logic,
    planner,
)

_JAXPLAN_SECTIONS = ("Compiler", "Planner", "Optimize")
_SECTIONS = (*_JAXPLAN_SECTIONS, "Noise", "MDPO", "Search")
_SWITCHES = {"stop_at_termination", "keep_group_limits"}
_SIZES = ("iterations_per_call", "test_every")
_DEFAULT_COMPILER = "DefaultJaxRDDLCompilerWithGrad"

_POSITIVE_INTEGERS = {
    "Planner": ("batch_size_train", "batch_size_test", "parallel_updates", "rollout_horizon"),
    "Optimize": ("epochs", "test_rolling_window"),
    "MDPO": _SIZES,
}
_POSITIVE_NUMBERS = {"Planner": ("clip_grad",), "Optimize": ("train_seconds",)}
_OPTIONAL = ("batch_size_test", "rollout_horizon", "clip_grad")
_MAX_KEY = 2**31 - 1

JaxPlanArguments = tuple[dict[str, Any], dict[str, Any], dict[str, Any]]


@dataclasses.dataclass(frozen=True)
class PlannerConfig:
    """The contents of one configuration file.

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
            text = Path(path).read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
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
        config = cls(parse_sections(text, source), source)
        config._check()
        return config

    def section(self, name: str) -> dict[str, Any]:
        """A copy of one section; empty if there is none."""
        return dict(self.sections.get(name, {}))

    def with_section(self, name: str, values: Mapping[str, Any]) -> "PlannerConfig":
        """A copy in which one section is replaced.

        Raises:
          InputError: as `from_text` does.
        """
        config = dataclasses.replace(self, sections={**self.sections, name: dict(values)})
        config._check()
        return config

    def without_section(self, name: str) -> "PlannerConfig":
        """A copy without one of the optional sections."""
        rest = {key: values for key, values in self.sections.items() if key != name}
        return dataclasses.replace(self, sections=rest)

    def with_values(self, name: str, **values: Any) -> "PlannerConfig":
        """A copy in which some keys of one section are set.

        Raises:
          InputError: as `from_text` does.
        """
        return self.with_section(name, {**self.section(name), **values})

    def to_text(self, for_jaxplan: bool = False) -> str:
        """The configuration as a file's text, which `from_text` reads back.

        Args:
          for_jaxplan: leave out the sections that JaxPlan does not know.
        """
        blocks = []
        for section in _JAXPLAN_SECTIONS if for_jaxplan else _SECTIONS:
            if section not in self.sections:
                continue
            lines = [f"{key}={value!r}" for key, value in self.sections[section].items()]
            blocks.append("\n".join([f"[{section}]", *lines]))
        return "\n\n".join(blocks) + "\n"

    def noise(self) -> ActionNoise:
        """The noise rule that `[Noise]` describes; the planner's default without the section."""
        if "Noise" not in self.sections:
            return noise_rules.default_noise()
        values = rule_values(self.section("Noise"))
        return getattr(noise_rules, values.pop("method"))(**values)

    def jaxplan_arguments(self) -> JaxPlanArguments:
        """JaxPlan's triple: the planner's, the plan's and `optimize`'s keyword arguments.

        Raises:
          InputError: if JaxPlan refuses the values.
        """
        try:
            section, ours = stand_ins(self.section("Planner"))
            known = dataclasses.replace(self, sections={**self.sections, "Planner": section})
            text = known.to_text(for_jaxplan=True)
            planner_args, plan_args, train_args = planner.load_config_from_string(text)
        except Exception as error:  # JaxPlan raises whatever the values make Python raise
            raise InputError(f"{self.source}: JaxPlan refuses it: {one_line(error)}") from error
        return {**planner_args, **ours}, plan_args, train_args

    def mdpo_arguments(self) -> dict[str, Any]:
        """What `MDPOPlanner` takes beside JaxPlan's arguments: the switches and any noise."""
        noise = {"noise": self.noise()} if "Noise" in self.sections else {}
        return {**noise, **self.section("MDPO")}

    def compiler_class(self) -> type:
        """The class that compiles the relaxed model."""
        return getattr(logic, self.section("Compiler").get("method", _DEFAULT_COMPILER))

    def _check(self) -> None:
        for section in self.sections:
            if section not in _SECTIONS:
                raise self._error(f"unknown section [{section}], known are {', '.join(_SECTIONS)}")
        for section in _JAXPLAN_SECTIONS:
            if section not in self.sections:
                raise self._error(f"section [{section}] is missing")
        self._check_compiler()
        self._check_planner()
        self._check_optimize()
        self._check_noise()
        self._check_switches()
        for section, keys in _POSITIVE_INTEGERS.items():
            self._check_positive(section, *keys, integer=True)
        for section, keys in _POSITIVE_NUMBERS.items():
            self._check_positive(section, *keys)
        self._check_sizes()
        self._check_search()
        for section, values in self.sections.items():
            for key, value in values.items():
                if key.endswith("_kwargs") and not isinstance(value, dict | None):
                    raise self._error(f"[{section}] {key}: must be a dictionary, got {value!r}")

    def _check_compiler(self) -> None:
        method = self.section("Compiler").get("method", _DEFAULT_COMPILER)
        compiler = concrete_class(logic, method, logic.JaxRDDLCompilerWithGrad)
        if compiler is None:
            raise self._error(f"[Compiler] method: JaxPlan has no relaxing compiler {method!r}")
        self._check_keys("Compiler", compiler_parameters(compiler) | {"method"})
        self._check_positive("Compiler", *sorted(relaxation_weights(compiler)))

    def _check_planner(self) -> None:
        values = self.section("Planner")
        if "method" not in values:
            raise self._error("[Planner] method is missing")
        plan = PLANS.get(values["method"]) or concrete_class(planner, values["method"], JaxPlan)
        if plan is None:
            raise self._error(f"[Planner] method: JaxPlan has no plan {values['method']!r}")
        known = parameters(JaxBackpropPlanner) - {"rddl", "plan", "compiler_kwargs"}
        extra = {"method", "method_kwargs", "pgpe_kwargs", "preprocessor_kwargs"}
        self._check_keys("Planner", known | extra)
        plan_values = values.get("method_kwargs", {})
        if not isinstance(plan_values, dict):
            raise self._error(f"[Planner] method_kwargs: must be a dictionary, got {plan_values!r}")
        plan_keys = parameters(plan) | {"initializer_kwargs"}
        for key in plan_values:
            if key not in plan_keys:
                known_keys = ", ".join(sorted(plan_keys))
                raise self._error(
                    f"[Planner] method_kwargs: unknown key {key!r}, known are {known_keys}"
                )
        modules = (planner.initializers, planner.nn.initializers)
        self._check_function("method_kwargs: initializer", plan_values.get("initializer"), modules)
        modules = (jax.nn, jax.numpy)
        self._check_function("method_kwargs: activation", plan_values.get("activation"), modules)
        if values.get("optimizer") not in OPTIMIZERS:
            self._check_function("optimizer", values.get("optimizer"), (optax,))
        for key, base in (("pgpe", planner.PGPE), ("preprocessor", planner.Preprocessor)):
            name = values.get(key)
            if name is not None and concrete_class(planner, name, base) is None:
                raise self._error(f"[Planner] {key}: JaxPlan has no {key} {name!r}")
        utility = values.get("utility", "mean")
        if str(utility).lower() not in planner.UTILITY_LOOKUP:
            names = ", ".join(planner.UTILITY_LOOKUP)
            raise self._error(f"[Planner] utility: unknown name {utility!r}, known are {names}")

    def _check_function(self, where: str, name: object, modules: tuple[ModuleType, ...]) -> None:
        if name is None:
            return
        if not any(callable(getattr(module, str(name), None)) for module in modules):
            names = " or ".join(module.__name__ for module in modules)
            raise self._error(f"[Planner] {where}: {names} has no function {name!r}")

    def _check_optimize(self) -> None:
        keys = optimize_parameters() | {"stopping_rule_kwargs"}
        # what JaxPlan's scripts hand on to a controller
        for controller in (JaxOfflineController, JaxOnlineController):
            keys |= parameters(controller) - {"planner"}
        self._check_keys("Optimize", keys)
        values = self.section("Optimize")
        rule = values.get("stopping_rule")
        base = planner.JaxPlannerStoppingRule
        if rule is not None and concrete_class(planner, rule, base) is None:
            raise self._error(f"[Optimize] stopping_rule: JaxPlan has no stopping rule {rule!r}")
        key = values.get("key")
        if key is not None and not (is_number(key, int) and 0 <= key <= _MAX_KEY):
            raise self._error(
                f"[Optimize] key: must be an integer from 0 to {_MAX_KEY}, got {key!r}"
            )

    def _check_positive(self, section: str, *keys: str, integer: bool = False) -> None:
        kind, name = (int, "integer") if integer else (int | float, "number")
        for key in keys:
            value = self.section(section).get(key, 1)
            if value is None and key in _OPTIONAL:
                continue
            if not (is_number(value, kind) and value > 0):
                raise self._error(f"[{section}] {key}: must be a positive {name}, got {value!r}")

    def _check_noise(self) -> None:
        values = rule_values(self.section("Noise"))
        method = values.pop("method")
        rule = concrete_class(noise_rules, method, ActionNoise)
        if rule is None:
            raise self._error(f"[Noise] method: no noise rule {method!r}")
        self._check_keys("Noise", parameters(rule) | {"method"})
        for key, value in values.items():
            if key not in NOT_NUMBERS and not is_number(value, int | float):
                raise self._error(f"[Noise] {key} must be a number, got {value!r}")
        try:
            rule(**values)
        except ValueError as error:
            raise self._error(f"[Noise] {error}") from error

    def _check_switches(self) -> None:
        self._check_keys("MDPO", _SWITCHES.union(_SIZES))
        for key, value in self.section("MDPO").items():
            if key in _SWITCHES and not isinstance(value, bool):
                raise self._error(f"[MDPO] {key}: must be True or False, got {value!r}")

    def _check_sizes(self) -> None:
        values = self.section("MDPO")
        size = values.get("iterations_per_call", 1)
        if size % values.get("test_every", size):
            raise self._error("[MDPO] test_every: must divide iterations_per_call")
        between = self.section("Planner")
        if size > 1 and ("pgpe" not in between or any(map(between.get, ("pgpe", "preprocessor")))):
            needs = "needs pgpe=None in [Planner], and no preprocessor"
            raise self._error(f"[MDPO] iterations_per_call: more than 1 {needs}")

    def _check_search(self) -> None:
        if "Search" not in self.sections:
            return
        values = self.section("Search")
        try:
            Search(**values)
        except (TypeError, ValueError) as error:
            raise self._error(f"[Search] {error}") from error
        if self.section("Planner").get("method") != "FeedbackPlan":
            raise self._error("[Search] needs method='FeedbackPlan' in [Planner]")

    def _check_keys(self, section: str, known: set[str]) -> None:
        for key in self.section(section):
            if key not in known:
                names = ", ".join(sorted(known)) or "none"
                raise self._error(f"[{section}] unknown key {key!r}, known are {names}")

    def _error(self, message: str) -> InputError:
        return InputError(f"{self.source}: {message}")


def optimize_parameters() -> set[str]:
    """Names of the arguments of JaxPlan's `optimize`."""
    return parameters(JaxBackpropPlanner.optimize_generator)


def relaxation_weights(compiler: type) -> set[str]:
    """Names of those arguments that are relaxation weights: larger is closer to exact."""
    return {name for name in compiler_parameters(compiler) if name.endswith("_weight")}


def load_config(path: str | Path) -> JaxPlanArguments:
    """JaxPlan's `load_config`, with `[Noise]` and `[MDPO]` read into the planner's arguments.

    Returns:
      The keyword arguments of `MDPOPlanner`, of its plan, and of `optimize`. There is a `noise`
      only where the file has a section `[Noise]`.

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
