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
from types import ModuleType
from typing import Any

import jax
import numpy as np
import optax
from flax.linen import initializers as flax_initializers

from mdpo_rddl import noise as noise_rules
from mdpo_rddl.errors import InputError
from mdpo_rddl.jaxplan.upstream import JaxBackpropPlanner, JaxPlan, logic, planner
from mdpo_rddl.noise import ActionNoise

_SECTIONS = ("Compiler", "Planner", "Optimize", "Noise")
_DEFAULT_COMPILER = "DefaultJaxRDDLCompilerWithGrad"
_DEFAULT_NOISE = "AdaptiveNoise"

_POSITIVE_INTEGERS = {
    "Planner": ("batch_size_train", "batch_size_test", "parallel_updates", "rollout_horizon"),
    "Optimize": ("epochs", "test_rolling_window"),
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
        parser = configparser.RawConfigParser()
        parser.optionxform = str  # type: ignore[assignment,method-assign]  # keys keep their case
        try:
            parser.read_string(text)
        except configparser.Error as error:
            raise _syntax_error(source, error) from error
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
        self._check_optimize()
        self._check_noise()
        for section, keys in _POSITIVE_INTEGERS.items():
            self._check_positive(section, *keys, integer=True)
        for section, keys in _POSITIVE_NUMBERS.items():
            self._check_positive(section, *keys)
        for section, values in self.sections.items():
            for key, value in values.items():
                if key.endswith("_kwargs") and not isinstance(value, dict | None):
                    raise self._error(f"[{section}] {key}: must be a dictionary, got {value!r}")

    def _check_compiler(self) -> None:
        method = self.section("Compiler").get("method", _DEFAULT_COMPILER)
        compiler = _concrete_class(logic, method, logic.JaxRDDLCompilerWithGrad)
        if compiler is None:
            raise self._error(f"[Compiler] method: JaxPlan has no relaxing compiler {method!r}")
        self._check_keys("Compiler", compiler_parameters(compiler) | {"method"})
        self._check_positive("Compiler", *sorted(relaxation_weights(compiler)))

    def _check_planner(self) -> None:
        values = self.section("Planner")
        if "method" not in values:
            raise self._error("[Planner] method is missing")
        plan = _concrete_class(planner, values["method"], JaxPlan)
        if plan is None:
            raise self._error(f"[Planner] method: JaxPlan has no plan {values['method']!r}")
        known = _parameters(JaxBackpropPlanner) - {"rddl", "plan", "compiler_kwargs"}
        extra = {"method", "method_kwargs", "pgpe_kwargs", "preprocessor_kwargs"}
        self._check_keys("Planner", known | extra)
        plan_values = values.get("method_kwargs", {})
        if not isinstance(plan_values, dict):
            raise self._error(f"[Planner] method_kwargs: must be a dictionary, got {plan_values!r}")
        plan_keys = _parameters(plan) | {"initializer_kwargs"}
        for key in plan_values:
            if key not in plan_keys:
                known_keys = ", ".join(sorted(plan_keys))
                raise self._error(
                    f"[Planner] method_kwargs: unknown key {key!r}, known are {known_keys}"
                )
        modules = (jax.nn.initializers, flax_initializers)
        self._check_function("method_kwargs: initializer", plan_values.get("initializer"), modules)
        modules = (jax.nn, jax.numpy)
        self._check_function("method_kwargs: activation", plan_values.get("activation"), modules)
        self._check_function("optimizer", values.get("optimizer"), (optax,))
        for key, base in (("pgpe", planner.PGPE), ("preprocessor", planner.Preprocessor)):
            name = values.get(key)
            if name is not None and _concrete_class(planner, name, base) is None:
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
        keys = _parameters(JaxBackpropPlanner.optimize_generator)
        self._check_keys("Optimize", keys | {"stopping_rule_kwargs"})
        values = self.section("Optimize")
        rule = values.get("stopping_rule")
        base = planner.JaxPlannerStoppingRule
        if rule is not None and _concrete_class(planner, rule, base) is None:
            raise self._error(f"[Optimize] stopping_rule: JaxPlan has no stopping rule {rule!r}")
        key = values.get("key")
        if key is not None and not (_is_number(key, int) and 0 <= key <= _MAX_KEY):
            raise self._error(
                f"[Optimize] key: must be an integer from 0 to {_MAX_KEY}, got {key!r}"
            )

    def _check_positive(self, section: str, *keys: str, integer: bool = False) -> None:
        kind, name = (int, "integer") if integer else (int | float, "number")
        for key in keys:
            value = self.section(section).get(key, 1)
            if value is None and key in _OPTIONAL:
                continue
            if not (_is_number(value, kind) and value > 0):
                raise self._error(f"[{section}] {key}: must be a positive {name}, got {value!r}")

    def _check_noise(self) -> None:
        values = self.section("Noise")
        method = values.pop("method", _DEFAULT_NOISE)
        rule = _concrete_class(noise_rules, method, ActionNoise)
        if rule is None:
            raise self._error(f"[Noise] method: no noise rule {method!r}")
        known = _parameters(rule)
        self._check_keys("Noise", known | {"method"})
        for key, value in values.items():
            if not _is_number(value, int | float):
                raise self._error(f"[Noise] {key} must be a number, got {value!r}")
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


def _concrete_class(module: ModuleType, name: object, base: type) -> type | None:
    found = getattr(module, str(name), None)
    is_usable = isinstance(found, type) and issubclass(found, base)
    return found if is_usable and not inspect.isabstract(found) else None


def _is_number(value: object, kind: Any) -> bool:
    return isinstance(value, kind) and not isinstance(value, bool)


def _literal(value: str, text: str, source: str, section: str, key: str) -> Any:
    try:
        literal = ast.literal_eval(value)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as error:
        start = re.escape(value.partition("\n")[0])
        line_of_it = rf"^[ \t]*{re.escape(key)}[ \t]*[=:][ \t]*{start}[ \t]*$"
        found = re.search(line_of_it, text, flags=re.MULTILINE)
        line = "" if found is None else ":" + str(text.count("\n", 0, found.end()) + 1)
        raise InputError(
            f"{source}{line}: [{section}] {key}: {value!r} is not a Python literal "
            "(is a quote missing?)"
        ) from error
    if not _is_finite(literal):
        raise InputError(f"{source}: [{section}] {key}: must be finite, got {literal}")
    return literal


def _is_finite(literal: Any) -> bool:
    if isinstance(literal, dict):
        return all(map(_is_finite, [*literal.keys(), *literal.values()]))
    if isinstance(literal, list | tuple | set):
        return all(map(_is_finite, literal))
    try:
        return not isinstance(literal, int | float) or bool(np.isfinite(float(literal)))
    except OverflowError:
        return False


def _syntax_error(source: str, error: configparser.Error) -> InputError:
    line = getattr(error, "lineno", None)
    if isinstance(error, configparser.DuplicateOptionError):
        cause = f"[{error.section}] {error.option}: given twice"
    elif isinstance(error, configparser.DuplicateSectionError):
        cause = f"section [{error.section}] begins twice"
    elif isinstance(error, configparser.MissingSectionHeaderError):
        cause = "no section header, such as [Planner], comes before this line"
    elif isinstance(error, configparser.ParsingError) and error.errors:
        line, cause = error.errors[0][0], "neither a section header nor key=value"
    else:
        cause = _one_line(error)
    return InputError(f"{source}{'' if line is None else f':{line}'}: {cause}")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
