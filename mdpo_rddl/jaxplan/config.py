"""JaxPlan's `.cfg` files, with an optional section `[Noise]`.

The format is JaxPlan's: sections `[Compiler]`, `[Planner]`, `[Optimize]`, each value a
Python literal. `[Noise]` names a rule of `mdpo_rddl.noise` as its `method` and that rule's
numbers. JaxPlan itself ignores the section, so one file serves both.
"""

import ast
import configparser
import dataclasses
import inspect
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl import noise as noise_rules
from mdpo_rddl.errors import InputError
from mdpo_rddl.jaxplan.upstream import JaxBackpropPlanner, JaxPlan, logic, planner
from mdpo_rddl.noise import ActionNoise

_SECTIONS = ("Compiler", "Planner", "Optimize", "Noise")
_DEFAULT_COMPILER = "DefaultJaxRDDLCompilerWithGrad"
_DEFAULT_NOISE = "AdaptiveNoise"

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
            text = Path(path).read_text(encoding="utf-8")
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
        parser = configparser.RawConfigParser()
        parser.optionxform = str  # type: ignore[assignment,method-assign]  # keys keep their case
        try:
            parser.read_string(text)
        except configparser.Error as error:
            raise InputError(f"{source}: {_one_line(error)}") from error
        sections = {
            section: {
                key: _literal(value, text, source, section, key)
                for key, value in parser.items(section)
            }
            for section in parser.sections()
        }
        config = cls(sections, source)
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

    def with_values(self, name: str, **values: Any) -> "PlannerConfig":
        """A copy in which some keys of one section are set.

        Raises:
          InputError: as `from_text` does.
        """
        return self.with_section(name, {**self.section(name), **values})

    def to_text(self, without_noise: bool = False) -> str:
        """The configuration as a file's text, which `from_text` reads back."""
        blocks = []
        for section in _SECTIONS:
            if section not in self.sections or (without_noise and section == "Noise"):
                continue
            lines = [f"{key}={value!r}" for key, value in self.sections[section].items()]
            blocks.append("\n".join([f"[{section}]", *lines]))
        return "\n\n".join(blocks) + "\n"

    def noise(self) -> ActionNoise:
        """The noise rule that `[Noise]` describes; `AdaptiveNoise()` without the section."""
        values = self.section("Noise")
        rule = getattr(noise_rules, values.pop("method", _DEFAULT_NOISE))
        return rule(**values)

    def jaxplan_arguments(self) -> JaxPlanArguments:
        """JaxPlan's triple: the planner's, the plan's and `optimize`'s keyword arguments.

        Raises:
          InputError: if JaxPlan refuses the values.
        """
        try:
            return planner.load_config_from_string(self.to_text(without_noise=True))
        except Exception as error:  # JaxPlan raises whatever the values make Python raise
            raise InputError(f"{self.source}: JaxPlan refuses it: {_one_line(error)}") from error

    def compiler_class(self) -> type:
        """The class that compiles the relaxed model."""
        return getattr(logic, self.section("Compiler").get("method", _DEFAULT_COMPILER))

    def _check(self) -> None:
        for section in self.sections:
            if section not in _SECTIONS:
                raise self._error(f"unknown section [{section}], known are {', '.join(_SECTIONS)}")
        for section in ("Compiler", "Planner", "Optimize"):
            if section not in self.sections:
                raise self._error(f"section [{section}] is missing")
        self._check_compiler()
        self._check_planner()
        optimize_keys = _parameters(JaxBackpropPlanner.optimize_generator)
        self._check_keys("Optimize", optimize_keys | {"stopping_rule_kwargs"})
        self._check_noise()

    def _check_compiler(self) -> None:
        method = self.section("Compiler").get("method", _DEFAULT_COMPILER)
        compiler = getattr(logic, str(method), None)
        if not isinstance(compiler, type):
            raise self._error(f"[Compiler] method: JaxPlan has no compiler {method!r}")
        self._check_keys("Compiler", compiler_parameters(compiler) | {"method"})

    def _check_planner(self) -> None:
        values = self.section("Planner")
        if "method" not in values:
            raise self._error("[Planner] method is missing")
        plan = getattr(planner, str(values["method"]), None)
        if not (isinstance(plan, type) and issubclass(plan, JaxPlan)):
            raise self._error(f"[Planner] method: JaxPlan has no plan {values['method']!r}")
        known = _parameters(JaxBackpropPlanner) - {"rddl", "plan", "compiler_kwargs"}
        extra = {"method", "method_kwargs", "pgpe_kwargs", "preprocessor_kwargs"}
        self._check_keys("Planner", known | extra)
        plan_values = values.get("method_kwargs", {})
        if not isinstance(plan_values, dict):
            raise self._error("[Planner] method_kwargs: not a dictionary")
        plan_keys = _parameters(plan) | {"initializer_kwargs"}
        for key in plan_values:
            if key not in plan_keys:
                known_keys = ", ".join(sorted(plan_keys))
                raise self._error(
                    f"[Planner] method_kwargs: unknown key {key!r}, known are {known_keys}"
                )
        for key in ("batch_size_train", "batch_size_test", "parallel_updates"):
            size = values.get(key)
            if size is not None and (not isinstance(size, int) or size < 1):
                raise self._error(f"[Planner] {key}: must be a positive integer, got {size!r}")

    def _check_noise(self) -> None:
        values = self.section("Noise")
        method = values.pop("method", _DEFAULT_NOISE)
        rule = getattr(noise_rules, str(method), None)
        if not (isinstance(rule, type) and issubclass(rule, ActionNoise)):
            raise self._error(f"[Noise] method: no noise rule {method!r}")
        known = _parameters(rule)
        self._check_keys("Noise", known | {"method"})
        try:
            rule(**values)
        except ValueError as error:
            raise self._error(f"[Noise] {error}") from error

    def _check_keys(self, section: str, known: set[str]) -> None:
        for key in self.section(section):
            if key not in known:
                names = ", ".join(sorted(known)) or "none"
                raise self._error(f"[{section}] unknown key {key!r}, known are {names}")

    def _error(self, message: str) -> InputError:
        return InputError(f"{self.source}: {message}")


def compiler_parameters(compiler: type) -> set[str]:
    """Names of the keyword arguments that a relaxing compiler accepts, its mixins' included."""
    names: set[str] = set()
    for base in inspect.getmro(compiler):
        if "__init__" in vars(base):
            names |= _parameters(vars(base)["__init__"])
    return names - {"rddl", "logger", "python_functions"}


def relaxation_weights(compiler: type) -> set[str]:
    """Names of those arguments that are relaxation weights: larger is closer to exact."""
    return {name for name in compiler_parameters(compiler) if name.endswith("_weight")}


def load_config(path: str | Path) -> JaxPlanArguments:
    """JaxPlan's `load_config`, with `[Noise]` read into the planner's arguments as `noise`.

    Returns:
      The keyword arguments of `MDPOPlanner`, of its plan, and of `optimize`.

    Raises:
      InputError: naming file, section and key.
    """
    return _with_noise(PlannerConfig.from_file(path))


def load_config_from_string(value: str) -> JaxPlanArguments:
    """As `load_config`, from the file's contents."""
    return _with_noise(PlannerConfig.from_text(value))


def _with_noise(config: PlannerConfig) -> JaxPlanArguments:
    planner_args, plan_args, train_args = config.jaxplan_arguments()
    return {**planner_args, "noise": config.noise()}, plan_args, train_args


def _parameters(function: Any) -> set[str]:
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    parameters = inspect.signature(function).parameters.values()
    return {p.name for p in parameters if p.kind in kinds} - {"self"}


def _literal(value: str, text: str, source: str, section: str, key: str) -> Any:
    try:
        literal = ast.literal_eval(value)
    except (ValueError, SyntaxError, TypeError) as error:
        start = re.escape(value.partition("\n")[0])
        found = re.search(rf"^\s*{re.escape(key)}\s*[=:]\s*{start}", text, flags=re.MULTILINE)
        line = "" if found is None else ":" + str(text.count("\n", 0, found.end()) + 1)
        raise InputError(
            f"{source}{line}: [{section}] {key}: {value!r} is not a Python literal "
            "(is a quote missing?)"
        ) from error
    if isinstance(literal, float) and not np.isfinite(literal):
        raise InputError(f"{source}: [{section}] {key}: must be finite, got {literal}")
    return literal


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
