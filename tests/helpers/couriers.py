"""Toys for plans: what must be done before something else, together, or undone again."""

from helpers.toys import problem_from
from mdpo_rddl.problem.load import Problem

_COURIER = """domain courier {
    types { place : object; };
    pvariables {
        NEXT(place, place) : { non-fluent, bool, default = false };
        FIRST(place) : { non-fluent, bool, default = false };
        LAST(place) : { non-fluent, bool, default = false };
        at(place) : { state-fluent, bool, default = false };
        holding : { state-fluent, bool, default = false };
        go : { action-fluent, bool, default = false };
        pick : { action-fluent, bool, default = false };
        hand-over : { action-fluent, bool, default = false };
    };
    cpfs {
        at'(?p) = if (go) then (exists_{?q : place} [NEXT(?q, ?p) ^ at(?q)]) else at(?p);
        holding' = if (hand-over) then false else (holding | (pick ^ Bernoulli(0.8)));
    };
    reward = 10 * hand-over - 1.0 * go;
    action-preconditions {
        pick => (exists_{?p : place} [FIRST(?p) ^ at(?p)]);
        go => (~(exists_{?p : place} [LAST(?p) ^ at(?p)]));
        hand-over => (holding ^ (exists_{?p : place} [LAST(?p) ^ at(?p)]));
    };
}
non-fluents way {
    domain = courier;
    objects { place : {p0, p1, p2}; };
    non-fluents { NEXT(p0, p1); NEXT(p1, p2); FIRST(p0); LAST(p2); };
}
instance inst {
    domain = courier;
    non-fluents = way;
    init-state { at(p0); };
    max-nondef-actions = 1;
    horizon = 8;
    discount = 1.0;
}"""

_LIFT = """domain lift {
    types { worker : object; };
    pvariables {
        up : { state-fluent, bool, default = false };
        pull(worker) : { action-fluent, bool, default = false };
    };
    cpfs { up' = up | (forall_{?w : worker} [pull(?w)]); };
    reward = 5 * up - 0.5 * (sum_{?w : worker} [pull(?w)]);
}
non-fluents pair { domain = lift; objects { worker : {w0, w1}; }; }
instance inst {
    domain = lift;
    non-fluents = pair;
    max-nondef-actions = pos-inf;
    horizon = 4;
    discount = 1.0;
}"""

_CAMERA = """domain camera {
    types { target : object; };
    pvariables {
        taken(target) : { state-fluent, bool, default = false };
        aim : { action-fluent, bool, default = false };
        shoot(target) : { action-fluent, bool, default = false };
    };
    cpfs { taken'(?t) = taken(?t) | shoot(?t); };
    reward = (sum_{?t : target} [taken(?t)]) - 0.5 * aim;
    action-preconditions { forall_{?t : target} [shoot(?t) => aim]; };
}
non-fluents two { domain = camera; objects { target : {t0, t1}; }; }
instance inst {
    domain = camera;
    non-fluents = two;
    init-state { taken(t0); };
    max-nondef-actions = 2;
    horizon = 4;
    discount = 1.0;
}"""

_TOWER = """domain tower {
    types { block : object; };
    pvariables {
        WANTED(block, block) : { non-fluent, bool, default = false };
        on(block, block) : { state-fluent, bool, default = false };
        put(block, block) : { action-fluent, bool, default = false };
        put-down(block) : { action-fluent, bool, default = false };
    };
    cpfs {
        on'(?b, ?c) = put(?b, ?c)
            | (on(?b, ?c) ^ ~put-down(?b) ^ ~(exists_{?d : block} [put(?b, ?d)]));
    };
    reward = (forall_{?b : block, ?c : block} [WANTED(?b, ?c) => on(?b, ?c)]);
    action-preconditions {
        forall_{?b : block} [put-down(?b) => ~(exists_{?c : block} [on(?c, ?b)])];
        forall_{?b : block, ?c : block} [put(?b, ?c)
            => ((?b ~= ?c) ^ ~(exists_{?d : block} [on(?d, ?b) | on(?d, ?c)]))];
    };
}
non-fluents four {
    domain = tower;
    objects { block : {b0, b1, b2, b3}; };
    non-fluents { WANTED(b0, b3); WANTED(b1, b0); WANTED(b2, b1); };
}
instance inst {
    domain = tower;
    non-fluents = four;
    init-state { on(b1, b0); on(b2, b1); };
    max-nondef-actions = 1;
    horizon = 8;
    discount = 1.0;
}"""


def courier():
    """Pick a parcel, which works four times of five, carry it two places on, hand it over."""
    return problem_from(_COURIER)


def lift():
    """Only if both pull at once is it up, which pays from then on."""
    return problem_from(_LIFT)


def camera():
    """Each target that was shot pays from then on; to shoot one the camera must be aimed."""
    return problem_from(_CAMERA)


def tower(ends=False):
    """Three blocks are to stand on a fourth one as they do beside it: in five moves.

    Args:
      ends: whether the episode ends once they stand there.
    """
    if not ends:
        return problem_from(_TOWER)
    wanted = "forall_{?b : block, ?c : block} [WANTED(?b, ?c) => on(?b, ?c)]"
    end = f"    termination {{ {wanted}; }};\n    action-pre"
    return problem_from(_TOWER.replace("    action-pre", end))


def hidden_courier() -> Problem:
    """The courier who does not see the parcel: what is felt is wrong now and then."""
    felt = "        felt : { observ-fluent, bool };\n        go : { action"
    text = _COURIER.replace("        go : { action", felt)
    law = "felt = if (holding') then Bernoulli(0.95) else Bernoulli(0.05);"
    return problem_from(text.replace("    };\n    reward", f"        {law}\n    }};\n    reward"))


def fires(legal: str = "") -> Problem:
    """A fire, which comes up by chance, and is put out where there is water.

    Args:
      legal: preconditions.
    """
    return problem_from(
        f"""domain fires {{
    pvariables {{
        burning : {{ state-fluent, bool, default = false }};
        filled : {{ state-fluent, bool, default = false }};
        fill : {{ action-fluent, bool, default = false }};
        pour : {{ action-fluent, bool, default = false }};
    }};
    cpfs {{
        filled' = (filled ^ ~pour) | fill;
        burning' = (burning ^ ~(pour ^ filled)) | Bernoulli(0.3);
    }};
    reward = -1.0 * burning - 0.1 * fill;
    action-preconditions {{ {legal} }};
}}
non-fluents none {{ domain = fires; }}
instance inst {{
    domain = fires;
    non-fluents = none;
    max-nondef-actions = 1;
    horizon = 12;
    discount = 1.0;
}}"""
    )
