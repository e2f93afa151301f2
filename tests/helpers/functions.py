"""All functions of RDDL at and beyond the edges of what they take, and what the environment says.

The arguments are real fluents a and b, whole ones i and j, and bools p and q.
"""

import itertools
import re

import numpy as np

from helpers.toys import problem_from
from mdpo_rddl.problem.load import make_environment

POINTS = tuple(itertools.product(range(-6, 7), repeat=2))
"""Twice the values of a and b; those of i and j."""

_ONE = [
    "abs",
    "sgn",
    "round",
    "floor",
    "ceil",
    "cos",
    "sin",
    "tan",
    "acos",
    "asin",
    "atan",
    "cosh",
    "sinh",
    "tanh",
    "exp",
    "ln",
    "sqrt",
]
_TWO = ["fmod", "min", "max", "log", "hypot"]
EXPRESSIONS = {
    **{f"{name} of {x}": f"{name}[{x}]" for name in _ONE for x in "aip"},
    **{
        f"{name} of {x} and {y}": f"{name}[{x}, {y}]"
        for name in _TWO
        for x, y in ("ab", "ij", "ib", "aj", "pq")
    },
    **{
        f"{name} of {x} and {y}": f"{name}[{x}, {y}]"
        for name in ("div", "mod")
        for x, y in ("ij", "pq", "ip", "pj")
    },
    **{f"pow of {x} and {y}": f"pow[{x}, {y}]" for x, y in ("ab", "aj", "ib", "pq")},
    "pow of whole numbers": "pow[i, abs[j]]",
    "div of rounded": "div[round[a], floor[b]]",
    "mod of rounded": "mod[sgn[a], ceil[b]]",
    "fmod of rounded": "fmod[round[a] - i, floor[b] * j]",
    "fmod of a choice": "fmod[if (p) then i else round[a], j]",
    "fmod of a half choice": "fmod[if (p) then i else a, j]",
    "pow of rounded": "pow[round[a], abs[floor[b]]]",
    **{
        f"{x} {operator} {y}": f"{x} {operator} {y}"
        for operator in "+-*/"
        for x, y in ("ab", "ij", "ib", "pq")
    },
    **{f"-{x}": f"-{x}" for x in "aip"},
    **{f"a {each} b": f"(a {each} b) + 0.0" for each in ("==", "~=", "<=", "<", ">=", ">")},
    **{f"p {each} q": f"(p {each} q) + 0.0" for each in ("^", "|", "=>", "<=>")},
    "not": "(~p) + 0.0",
    "if": "if (a > b) then i else b",
    "switch": "switch (c) { case @c1 : a, case @c2 : b, case @c3 : 7.0 }",
    "switch with a default": "switch (c) { case @c2 : b, default : 7.0 }",
    **{
        f"{name} of reals": f"{name}_{{?k : colour}} [a * WEIGHT(?k) - b]"
        for name in ("sum", "prod", "avg", "min", "max")
    },
    **{
        f"{name} of bools": f"{name}_{{?k : colour}} [WEIGHT(?k) > a]"
        for name in ("sum", "prod", "avg", "min", "max")
    },
    **{
        f"{name} of bools": f"({name}_{{?k : colour}} [WEIGHT(?k) > a]) + 0.0"
        for name in ("forall", "exists")
    },
}
BEYOND_THE_GROUND = {
    "lngamma": "lngamma[abs[a] + 0.25]",
    "gamma": "gamma[abs[a] + 0.25]",
    "argmin": "WEIGHT(argmin_{?k : colour} [a * WEIGHT(?k) * WEIGHT(?k) - b])",
    "argmax": "WEIGHT(argmax_{?k : colour} [a * WEIGHT(?k) * WEIGHT(?k) - b])",
}
"""What the ground model does not understand."""

_DOMAIN = """domain functions {
    types { %(types)s colour : {@c1, @c2, @c3}; };
    pvariables {
        WEIGHT(colour) : { non-fluent, real, default = 2.0 };
        %(fluents)s
        x : { action-fluent, bool, default = false };
    };
    cpfs { %(cpfs)s };
    reward = %(reward)s;
}
non-fluents n {
    domain = functions; %(objects)s
    non-fluents { WEIGHT(@c1) = -1.0; WEIGHT(@c2) = 0.5; };
}
instance i {
    domain = functions; non-fluents = n; init-state { %(init)s };
    max-nondef-actions = 1; horizon = 2; discount = 1.0;
}
"""


def side_by_side(expressions):
    """A problem whose next state has the expressions' values [len(POINTS)], as f0, f1, ..."""
    names = {"a": "a(?t)", "b": "b(?t)", "i": "i(?t)", "j": "j(?t)", "c": "c(?t)"}
    kinds = {"a": "real", "b": "real", "i": "int", "j": "int"}
    fluents = [
        f"{name}(point) : {{ state-fluent, {kind}, default = 0 }};" for name, kind in kinds.items()
    ]
    fluents += ["c(point) : { state-fluent, colour, default = @c1 };"]
    fluents += [
        f"f{k}(point) : {{ state-fluent, real, default = 0.0 }};" for k in range(len(expressions))
    ]
    cpfs = [f"{name}'(?t) = {name}(?t);" for name in (*kinds, "c")]
    cpfs += [f"f{k}'(?t) = {_with(each, names)};" for k, each in enumerate(expressions)]
    init = [
        f"a(t{k}) = {x / 2}; b(t{k}) = {y / 2}; i(t{k}) = {x}; j(t{k}) = {y};"
        f" c(t{k}) = @c{_colour(x, y) + 1};"
        for k, (x, y) in enumerate(POINTS)
    ]
    points = ", ".join(f"t{k}" for k in range(len(POINTS)))
    objects = f"objects {{ point : {{ {points} }}; }};"
    return _problem(fluents, cpfs, "0.0", init, ("point : object;", objects))


def one_by_one(expressions):
    """A problem with states i, j, c and `which`, whose reward is the value of that expression."""
    names = {"a": "(i / 2.0)", "b": "(j / 2.0)"}
    choices = [f"@w{k}" for k in range(len(expressions))]
    cases = ", ".join(
        f"case {w} : {_with(each, names)}" for w, each in zip(choices, expressions, strict=True)
    )
    kinds = {"i": "int", "j": "int", "c": "colour", "which": "choice"}
    defaults = {"colour": "@c1", "choice": "@w0", "int": "0"}
    fluents = [f"{n} : {{ state-fluent, {k}, default = {defaults[k]} }};" for n, k in kinds.items()]
    cpfs = [f"{name}' = {name};" for name in kinds]
    kind = f"choice : {{ {', '.join(choices)} }};"
    return _problem(fluents, cpfs, f"switch (which) {{ {cases} }}", ["i = 0;"], (kind, ""))


def states_one_by_one(count):
    """States [4, count * len(POINTS)] of that problem: all points for each expression."""
    points = np.array([(x, y, _colour(x, y)) for x, y in POINTS]).T
    which = np.repeat(np.arange(count), len(POINTS))
    return np.vstack([np.tile(points, count), which])


def in_the_environment(expressions):
    """What they are there [len(expressions), len(POINTS)]."""
    env = make_environment(side_by_side(expressions))
    env.reset(seed=0)
    state = env.step({})[0]
    return np.array([state[f"f{k}"] for k in range(len(expressions))], float)


def _with(expression, names):
    """The expression with its arguments named otherwise."""
    bools = {"p": f"({names.get('i', 'i')} > 0)", "q": f"({names.get('j', 'j')} > 0)"}
    return re.sub(
        r"(?<![\w?@])[abcijpq](?!\w)", lambda m: {**bools, **names}.get(m[0], m[0]), expression
    )


def _colour(x, y):
    return (x + y) % 3


def _problem(fluents, cpfs, reward, init, types_and_objects):
    types, objects = types_and_objects
    parts = {"fluents": fluents, "cpfs": cpfs, "init": init}
    joined = {name: "\n".join(each) for name, each in parts.items()}
    return problem_from(_DOMAIN % {**joined, "reward": reward, "types": types, "objects": objects})
