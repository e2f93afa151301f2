"""Shops that buy and hire within preconditions that are linear in what they do."""

from helpers.toys import problem_from
from mdpo_rddl.problem.load import Problem

DOMAIN = """
domain orders {
    types { shop : object; item : object; grade : { @low, @high }; };
    pvariables {
        WEIGHT(grade) : { non-fluent, real, default = 2.0 };
        PRICE(item) : { non-fluent, real, default = 1.0 };
        cash(shop) : { state-fluent, real, default = 6.0 };
        count(shop) : { state-fluent, int, default = 1 };
        kind(shop) : { state-fluent, grade, default = @low };
        is-open : { state-fluent, bool, default = true };
        buy(shop, item) : { action-fluent, real, default = 0.0 };
        hire(shop) : { action-fluent, int, default = 0 };
        close : { action-fluent, bool, default = false };
    };
    cpfs {
        cash'(?s) = cash(?s) + hire(?s) - (sum_{?i : item} [PRICE(?i) * buy(?s, ?i)]) / 2.0;
        count'(?s) = count(?s);
        kind'(?s) = kind(?s);
        is-open' = is-open ^ ~close;
    };
    reward = (sum_{?s : shop, ?i : item} [buy(?s, ?i)]) - (sum_{?s : shop} [hire(?s)]);
    action-preconditions { RULES };
}
non-fluents nf {
    domain = orders; objects { shop : {x, y}; item : {a, b}; };
    non-fluents { PRICE(b) = 2.0; WEIGHT(@high) = 3.0; };
}
instance one {
    domain = orders; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 5; discount = 1.0;
}
"""
BUDGETS = "forall_{?s : shop} [(sum_{?i : item} [PRICE(?i) * buy(?s, ?i)]) <= cash(?s)];"
STAFF = "(sum_{?s : shop} [hire(?s)]) <= 3;"
BOXES = """forall_{?s : shop, ?i : item} [buy(?s, ?i) >= 0 ^ buy(?s, ?i) <= 9];
    forall_{?s : shop} [hire(?s) >= 0 ^ hire(?s) <= 8];"""


def orders(rules: str) -> Problem:
    """The problem with preconditions beside the boxes."""
    return problem_from(DOMAIN.replace("RULES", BOXES + rules))
