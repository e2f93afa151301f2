"""What the check of a configuration asks of names and values."""

import inspect
from types import ModuleType
from typing import Any

from mdpo_rddl.planner.upstream import JaxBackpropPlanner


def parameters(function: Any) -> set[str]:
    """Names of what can be given to a function by name."""
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    parameters = inspect.signature(function).parameters.values()
    return {p.name for p in parameters if p.kind in kinds} - {"self"}


def concrete_class(module: ModuleType, name: object, base: type) -> type | None:
    """The class of a module with that name, if it is a subclass of `base` that can be made."""
    found = getattr(module, str(name), None)
    is_usable = isinstance(found, type) and issubclass(found, base)
    return found if is_usable and not inspect.isabstract(found) else None


def is_number(value: object, kind: Any) -> bool:
    """Whether a literal is a number of a kind; True and False are none."""
    return isinstance(value, kind) and not isinstance(value, bool)


def compiler_parameters(compiler: type) -> set[str]:
    """Names of the keyword arguments that a relaxing compiler accepts, its mixins' included."""
    names: set[str] = set()
    for base in inspect.getmro(compiler):
        if "__init__" in vars(base):
            names |= parameters(vars(base)["__init__"])
    return names - {"rddl", "logger", "python_functions"}


def relaxation_weights(compiler: type) -> set[str]:
    """Names of those arguments that are relaxation weights: larger is closer to exact."""
    return {name for name in compiler_parameters(compiler) if name.endswith("_weight")}


def optimize_parameters() -> set[str]:
    """Names of the arguments of JaxPlan's `optimize`."""
    return parameters(JaxBackpropPlanner.optimize_generator)
