"""Small problems whose preconditions a test chooses, each of one kind of action."""

from helpers.toys import problem_from
from mdpo_rddl.problem.load import Problem

PICKS = """
domain picks {
    types { item : object; };
    pvariables {
        PRICE(item) : { non-fluent, real, default = 1.0 };
        free(item) : { state-fluent, bool, default = true };
        bag : { state-fluent, real, default = 0.0 };
        pick(item) : { action-fluent, bool, default = false };
        stay : { action-fluent, bool, default = false };
        gear : { action-fluent, int, default = 0 };
    };
    cpfs {
        free'(?i) = if (stay) then free(?i) else free(?i) ^ ~pick(?i);
        bag' = bag + (sum_{?i : item} [PRICE(?i) * pick(?i)]) + gear;
    };
    reward = bag - stay;
    action-preconditions { RULES };
}
non-fluents nf {
    domain = picks; objects { item : {a, b, c}; };
    non-fluents { PRICE(a) = 1.0; PRICE(b) = 2.0; PRICE(c) = 4.0; };
}
instance one {
    domain = picks; non-fluents = nf; max-nondef-actions = MOST; horizon = 4; discount = 1.0;
}
"""
IS_FREE = "forall_{?i : item} [pick(?i) => free(?i)];"
EXACTLY_ONE = "stay + (sum_{?i : item} [pick(?i)]) == 1;"
CHEAP = "(sum_{?i : item} [PRICE(?i) * pick(?i)]) <= 4;"
# where nobody stays everything is picked, which no single change does
ALL_OR_STAY = "~stay => forall_{?i : item} [pick(?i)];"
TAKES = """
domain takes {
    types { item : object; };
    pvariables {
        CAP(item) : { non-fluent, int, default = 2 };
        taken(item) : { state-fluent, int, default = 0 };
        take(item) : { action-fluent, int, default = 0 };
    };
    cpfs { taken'(?i) = take(?i); };
    reward = sum_{?i : item} [take(?i)];
    action-preconditions {
        forall_{?i : item} [take(?i) >= 0]; forall_{?i : item} [take(?i) <= CAP(?i)]; RULES
    };
}
non-fluents nf {
    domain = takes; objects { item : {a, b}; }; non-fluents { CAP(b) = 5; };
}
instance one {
    domain = takes; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 4; discount = 1.0;
}
"""
PUSHES = """
domain pushes {
    types { unit : object; };
    pvariables {
        x(unit) : { state-fluent, real, default = 0.0 };
        push(unit) : { action-fluent, real, default = 0.0 };
        light : { action-fluent, bool, default = false };
    };
    cpfs { x'(?u) = x(?u) + push(?u); };
    reward = -(sum_{?u : unit} [pow[x(?u) - 0.5, 2]]);
    action-preconditions {
        forall_{?u : unit} [push(?u) >= -1.0]; forall_{?u : unit} [push(?u) <= 1.0]; RULES
    };
}
non-fluents nf { domain = pushes; objects { unit : {u1, u2}; }; }
instance one {
    domain = pushes; non-fluents = nf; max-nondef-actions = MOST; horizon = 4; discount = 1.0;
}
"""
AHEAD = "forall_{?u : unit} [push(?u) <= 0.2 + x(?u)];"
SHARED = "(sum_{?u : unit} [push(?u)]) <= 0.3 + (sum_{?u : unit} [x(?u)]);"
SQUARES = "(sum_{?u : unit} [pow[push(?u), 2]]) <= 0.2601;"


def picks(rules: str, most: str = "pos-inf") -> Problem:
    """Bools, and one whole number."""
    return problem_from(PICKS.replace("RULES", rules).replace("MOST", most))


def takes(rules: str) -> Problem:
    """Whole numbers, each with a box of its own."""
    return problem_from(TAKES.replace("RULES", rules))


def pushes(rules: str = AHEAD, most: str = "pos-inf") -> Problem:
    """Reals between -1 and 1, and a bool."""
    return problem_from(PUSHES.replace("RULES", rules).replace("MOST", most))
