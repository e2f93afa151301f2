"""When the environment raises an error, as RDDL: a distribution's parameter is out of range.

The environment looks at every law of a step, also at those that no reward and no state depends on.
"""

from collections.abc import Iterator
from typing import Any

from pyRDDLGym.core.debug.decompiler import RDDLDecompiler

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.chance import draws

_text = RDDLDecompiler().decompile_expr

# of laws by their names: what each parameter may not be; those of other laws are not looked at
_NONE = ""
# each is true of NaN
_NEGATIVE, _NOT_POSITIVE = "~({0} >= 0)", "~({0} > 0)"
_NO_PROBABILITY = "~(({0} >= 0) ^ ({0} <= 1))"
_REFUSED = {
    "KronDelta": (_NONE,),
    "DiracDelta": (_NONE,),
    "Bernoulli": (_NO_PROBABILITY,),
    "Geometric": (_NO_PROBABILITY,),
    "Binomial": (_NEGATIVE, _NO_PROBABILITY),
    "Poisson": (_NEGATIVE,),
    "Exponential": (_NOT_POSITIVE,),
    "Normal": (_NONE, _NEGATIVE),
}
# when the branches of an `if` are taken
_IF = "{0}", "~({0})"
# as the environment compares the sum of a Discrete's probabilities with 1
_TOLERANCE = "0.00001"


class NoConditionError(InputError):
    """It is not known: a law is another one, or a reward may not read its parameters."""


def error_condition(model: Any) -> str:
    """A bool in RDDL that is true at the steps at which the environment raises an error.

    A law counts where its branch is taken; the environment may look at another one, too, where some
    objects take each. It counts where the rest of a product or a conjunction is 0, at which the
    environment may not look at it.

    Args:
      model: pyRDDLGym's lifted model.

    Returns:
      What a reward of the model may read.

    Raises:
      NoConditionError: if this is not known of all laws, or if none has a parameter that can leave
        its range.
    """
    found = []
    for parameters, law in [*model.cpfs.values(), ([], model.reward)]:
        found += [_for_some(parameters, each) for each in _conditions(law)]
    if not found:
        raise NoConditionError("no law has a parameter that can leave its range")
    return " | ".join(f"({each})" for each in dict.fromkeys(found))


def _for_some(parameters: list[tuple[str, str]], condition: str) -> str:
    if not parameters:
        return condition
    quantified = ", ".join(f"{name} : {kind}" for name, kind in parameters)
    return f"exists_{{{quantified}}} [{condition}]"


def _conditions(expression: Any) -> Iterator[str]:
    """Each of which means an error at an expression, by the parameters that it is within."""
    if isinstance(expression, (tuple, list)):
        for each in expression:
            yield from _conditions(each)
    if not hasattr(expression, "etype"):
        return
    kind, name = expression.etype
    if kind in ("randomvar", "randomvector"):
        yield from _of_law(expression)
    if kind == "aggregation":
        *pairs, body = expression.args
        parameters = [pair for _, pair in pairs]
        yield from (_for_some(parameters, each) for each in _conditions(body))
    elif kind == "control":
        decides, *branches = expression.args
        yield from _conditions(decides)
        guarded = zip(_IF, branches, strict=True) if name == "if" else _switched(branches)
        for guard, branch in guarded:
            for each in _conditions(branch):
                yield f"({_read(guard, [decides])}) ^ ({each})"
    elif kind != "constant":
        yield from _conditions(expression.args)


def _switched(cases: list[Any]) -> Iterator[tuple[str, Any]]:
    """Of each case when it is taken, and its value."""
    values = [case[0] for kind, case in cases if kind == "case"]
    for kind, case in cases:
        if kind == "case":
            yield f"{{0}} == {case[0]}", case[1]
        else:
            yield " ^ ".join(["true", *(f"({{0}} ~= {value})" for value in values)]), case


def _of_law(law: Any) -> Iterator[str]:
    _, name = law.etype
    if all(getattr(each, "etype", "?")[0] == "constant" for each in law.args):
        return
    if name in ("Discrete", "UnnormDiscrete"):
        chances = [chance for _, (_, chance) in law.args[1:]]
        refused = [(_NEGATIVE, [chance]) for chance in chances]
        total = " + ".join(f"{{{place}}}" for place in range(len(chances)))
        is_one = f"~(abs[{total} - 1] <= {_TOLERANCE})"
        refused.append((is_one if name == "Discrete" else f"~({total} > 0)", chances))
    elif name in _REFUSED:
        pairs = zip(_REFUSED[name], law.args, strict=True)
        refused = [(template, [parameter]) for template, parameter in pairs if template != _NONE]
    else:
        raise NoConditionError(f"{name} is not known")
    for template, parameters in refused:
        if not all(each.etype[0] == "constant" for each in parameters):
            yield _read(template, parameters)


def _read(template: str, expressions: list[Any]) -> str:
    """The template with what is read put in.

    Raises:
      NoConditionError: if a reward may not read it.
    """
    texts = [_text(each) for each in expressions]
    if any(map(draws, expressions)):
        raise NoConditionError(f"{texts[0]} is drawn")
    return template.format(*(f"({text})" for text in texts))
