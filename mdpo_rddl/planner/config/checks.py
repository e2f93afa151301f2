"""Whether JaxPlan, the noise rules and the planner accept what a configuration says."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import jax
import optax

from mdpo_rddl import noise as noise_rules
from mdpo_rddl.errors import InputError
from mdpo_rddl.noise import ActionNoise
from mdpo_rddl.planner.config.bounds import out_of_bounds
from mdpo_rddl.planner.config.extensions import OPTIMIZERS, PLANS
from mdpo_rddl.planner.config.noise_section import NOT_NUMBERS, lacks_unit, rule_values
from mdpo_rddl.planner.config.search_section import SEARCH, read_search
from mdpo_rddl.planner.config.text import DEFAULT_COMPILER, JAXPLAN_SECTIONS, SECTIONS
from mdpo_rddl.planner.config.values import (
    compiler_parameters,
    concrete_class,
    is_number,
    optimize_parameters,
    parameters,
    relaxation_weights,
)
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.planner.plans.memory import MemoryShape
from mdpo_rddl.planner.upstream import (
    JaxBackpropPlanner,
    JaxOfflineController,
    JaxOnlineController,
    JaxPlan,
    logic,
    planner,
)

_SWITCHES = {"stop_at_termination", "keep_group_limits"}
_SIZES = ("iterations_per_call", "test_every")
_POSITIVE_INTEGERS = {
    "Planner": ("batch_size_train", "batch_size_test", "parallel_updates", "rollout_horizon"),
    "Optimize": ("epochs", "test_rolling_window"),
    "MDPO": _SIZES,
}
_POSITIVE_NUMBERS = {"Planner": ("clip_grad",), "Optimize": ("train_seconds",)}
_OPTIONAL = ("batch_size_test", "rollout_horizon", "clip_grad")
_MAX_KEY = 2**31 - 1
# of a feedback policy's shape: what is looked at before there is a problem
_OF_SHAPE = (
    "squares",
    "distant",
    "lifted",
    "pairs",
    "plan",
    "state_scales",
    "cut_feedback",
    "lookups",
)


def check_sections(sections: Mapping[str, Mapping[str, Any]], source: str) -> None:
    """Checks the contents of a configuration.

    Args:
      sections: per section, its keys and literal values.
      source: where it came from.

    Raises:
      InputError: naming source, section and key, if a section or key is unknown or missing, or a
        name or number is one that neither JaxPlan nor the noise rule accepts.
    """
    _Checks(sections, source).run()


@dataclass(frozen=True)
class _Checks:
    sections: Mapping[str, Mapping[str, Any]]
    source: str

    def run(self) -> None:
        for section in self.sections:
            if section not in SECTIONS:
                raise self._error(f"unknown section [{section}], known are {', '.join(SECTIONS)}")
        for section in JAXPLAN_SECTIONS:
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
        self._check_kwargs()
        beyond = out_of_bounds(self.sections)
        if beyond is not None:
            raise self._error(beyond)

    def _check_compiler(self) -> None:
        method = self._section("Compiler").get("method", DEFAULT_COMPILER)
        compiler = concrete_class(logic, method, logic.JaxRDDLCompilerWithGrad)
        if compiler is None:
            raise self._error(f"[Compiler] method: JaxPlan has no relaxing compiler {method!r}")
        self._check_keys("Compiler", compiler_parameters(compiler) | {"method"})
        self._check_positive("Compiler", *sorted(relaxation_weights(compiler)))
        self._check_positive("Compiler", "binomial_nbins", "poisson_nbins", integer=True)

    def _check_planner(self) -> None:
        values = self._section("Planner")
        if "method" not in values:
            raise self._error("[Planner] method is missing")
        plan_keys = self._plan_parameters(values["method"])
        # the relaxation is [Compiler]'s method
        known = parameters(JaxBackpropPlanner) - {"rddl", "plan", "compiler", "compiler_kwargs"}
        extra = {"method", "method_kwargs", "pgpe_kwargs", "preprocessor_kwargs"}
        self._check_keys("Planner", known | extra)
        plan_values = values.get("method_kwargs", {})
        if not isinstance(plan_values, dict):
            raise self._error(f"[Planner] method_kwargs: must be a dictionary, got {plan_values!r}")
        for key in plan_values:
            if key not in plan_keys:
                known_keys = ", ".join(sorted(plan_keys))
                raise self._error(
                    f"[Planner] method_kwargs: unknown key {key!r}, known are {known_keys}"
                )
        modules = (planner.initializers, planner.nn.initializers)
        try:
            MemoryShape.of(plan_values.get("memory"))
            given = {key: plan_values[key] for key in _OF_SHAPE if key in plan_values}
            FeedbackShape(**given)
        except ValueError as error:
            raise self._error(f"[Planner] method_kwargs: {error}") from error
        self._check_function("method_kwargs: initializer", plan_values.get("initializer"), modules)
        modules = (jax.nn, jax.numpy)
        self._check_function("method_kwargs: activation", plan_values.get("activation"), modules)
        if str(values.get("optimizer")) not in OPTIMIZERS:
            self._check_function("optimizer", values.get("optimizer"), (optax,))
        for key, base in (("pgpe", planner.PGPE), ("preprocessor", planner.Preprocessor)):
            name = values.get(key)
            if name is not None and concrete_class(planner, name, base) is None:
                raise self._error(f"[Planner] {key}: JaxPlan has no {key} {name!r}")
        utility = values.get("utility", "mean")
        if str(utility).lower() not in planner.UTILITY_LOOKUP:
            names = ", ".join(planner.UTILITY_LOOKUP)
            raise self._error(f"[Planner] utility: unknown name {utility!r}, known are {names}")

    def _plan_parameters(self, method: Any) -> set[str]:
        if isinstance(method, str) and method in PLANS:
            return set(PLANS[method].parameters)
        plan = concrete_class(planner, method, JaxPlan)
        if plan is None:
            raise self._error(f"[Planner] method: JaxPlan has no plan {method!r}")
        return parameters(plan) | {"initializer_kwargs"}

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
        values = self._section("Optimize")
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
            value = self._section(section).get(key, 1)
            if value is None and key in _OPTIONAL:
                continue
            if not (is_number(value, kind) and value > 0):
                raise self._error(f"[{section}] {key}: must be a positive {name}, got {value!r}")

    def _check_noise(self) -> None:
        values = rule_values(self._section("Noise"))
        method = values.pop("method")
        rule = concrete_class(noise_rules, method, ActionNoise)
        if rule is None:
            raise self._error(f"[Noise] method: no noise rule {method!r}")
        self._check_keys("Noise", parameters(rule) | {"method"})
        for key, value in values.items():
            if key not in NOT_NUMBERS and not is_number(value, int | float):
                raise self._error(f"[Noise] {key} must be a number, got {value!r}")
        unclear = lacks_unit(self._section("Noise"))
        if unclear is not None:
            raise self._error(f"[Noise] {unclear}")
        try:
            rule(**values)
        except ValueError as error:
            raise self._error(f"[Noise] {error}") from error

    def _check_switches(self) -> None:
        self._check_keys("MDPO", _SWITCHES.union(_SIZES))
        for key, value in self._section("MDPO").items():
            if key in _SWITCHES and not isinstance(value, bool):
                raise self._error(f"[MDPO] {key}: must be True or False, got {value!r}")

    def _check_sizes(self) -> None:
        values = self._section("MDPO")
        size = values.get("iterations_per_call", 1)
        if size % values.get("test_every", size):
            raise self._error("[MDPO] test_every: must divide iterations_per_call")
        between = self._section("Planner")
        if size > 1 and ("pgpe" not in between or any(map(between.get, ("pgpe", "preprocessor")))):
            needs = "needs pgpe=None in [Planner], and no preprocessor"
            raise self._error(f"[MDPO] iterations_per_call: more than 1 {needs}")

    def _check_search(self) -> None:
        try:
            read_search(self.sections)
        except (TypeError, ValueError) as error:
            raise self._error(f"[{SEARCH}] {error}") from error

    def _check_kwargs(self) -> None:
        for section, values in self.sections.items():
            for key, value in values.items():
                if key.endswith("_kwargs") and not isinstance(value, dict | None):
                    raise self._error(f"[{section}] {key}: must be a dictionary, got {value!r}")

    def _check_keys(self, section: str, known: set[str]) -> None:
        for key in self._section(section):
            if key not in known:
                names = ", ".join(sorted(known)) or "none"
                raise self._error(f"[{section}] unknown key {key!r}, known are {names}")

    def _error(self, message: str) -> InputError:
        return InputError(f"{self.source}: {message}")

    def _section(self, name: str) -> dict[str, Any]:
        return dict(self.sections.get(name, {}))
