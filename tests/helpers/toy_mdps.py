"""Problems so small that their optimum is worked out by hand."""

from itertools import pairwise
from pathlib import Path

from mdpo_rddl.problem.load import Problem, load_problem

_INSTANCE = """
non-fluents nf {{
    domain = {domain};
    {non_fluents}
}}

instance inst {{
    domain = {domain};
    non-fluents = nf;
    {start}
    max-nondef-actions = {actions};
    horizon = {horizon};
    discount = {discount};
}}
"""

_LAMP = """
domain lamp {
    pvariables {
        on : { state-fluent, bool, default = false };
        press : { action-fluent, bool, default = false };
    };
    cpfs {
        on' = if (press) then Bernoulli(0.5) else Bernoulli(on * 0.75);
    };
    reward = on - 0.125 * press;
}
"""

_GAMBLER = """
domain gambler {
    pvariables {
        capital : { state-fluent, int, default = 1 };
        stake : { action-fluent, bool, default = false };
        stake-two : { action-fluent, bool, default = false };
    };
    cpfs {
        capital' = capital + (Bernoulli(0.4) * 2 - 1) * (stake + 2 * stake-two);
    };
    reward = (capital' == 3);
    action-preconditions {
        stake + stake-two <= 1;
        stake => (capital > 0);
        stake-two => (capital > 1);
    };
    termination {
        capital >= 3;
        capital <= 0;
    };
}
"""

_WALK = """
domain walk {
    types {
        cell : object;
        weather : { @dry, @wet };
    };
    pvariables {
        RIGHT(cell, cell) : { non-fluent, bool, default = false };
        GOAL(cell) : { non-fluent, bool, default = false };
        at(cell) : { state-fluent, bool, default = false };
        sky : { state-fluent, weather, default = @dry };
        slippery : { interm-fluent, bool };
        go : { action-fluent, bool, default = false };
        dance(cell) : { action-fluent, bool, default = false };
    };
    cpfs {
        slippery = sky == @wet;
        sky' = Discrete(weather, @dry : 0.5, @wet : 0.5);
        at'(?c) = if (exists_{?d : cell} [at(?d) ^ GOAL(?d)]) then KronDelta(at(?c))
                  else if (go ^ ~slippery)
                  then KronDelta(exists_{?d : cell} [RIGHT(?d, ?c) ^ at(?d)])
                  else KronDelta(at(?c));
    };
    reward = sum_{?c : cell} [-1.0 * (GOAL(?c) ^ ~at(?c))];
}
"""


_SHARED_DRAW = """
domain shared_draw {
    pvariables {
        left : { state-fluent, bool, default = false };
        right : { state-fluent, bool, default = false };
        coin : { interm-fluent, bool };
        flip : { action-fluent, bool, default = false };
    };
    cpfs {
        coin = Bernoulli(0.5);
        left' = coin ^ flip;
        right' = coin ^ flip;
    };
    reward = left ^ right;
}
"""

_ONE_WAY = """
domain one_way {
    types {
        place : object;
        porter : object;
    };
    pvariables {
        NEXT(place, place) : { non-fluent, bool, default = false };
        at(porter, place) : { state-fluent, bool, default = false };
        coin(place) : { state-fluent, bool, default = true };
        go(porter) : { action-fluent, bool, default = false };
        take(porter) : { action-fluent, bool, default = false };
    };
    cpfs {
        at'(?r, ?p) = if (go(?r) ^ exists_{?q : place} [at(?r, ?q) ^ NEXT(?q, ?p)]) then true
                      else if (go(?r) ^ exists_{?q : place} [NEXT(?p, ?q)]) then false
                      else at(?r, ?p);
        coin'(?p) = if (exists_{?r : porter} [take(?r) ^ at(?r, ?p)]) then Bernoulli(0.5 * coin(?p))
                    else coin(?p);
    };
    reward = sum_{?p : place} [coin(?p) ^ exists_{?r : porter} [take(?r) ^ at(?r, ?p)]]
             - 0.125 * sum_{?r : porter} [go(?r)];
}
"""

_COUNTER = """
domain counter {
    pvariables {
        other : { state-fluent, bool, default = false };
        counts : { state-fluent, bool, default = true };
        count : { state-fluent, int, default = 0 };
        wait : { action-fluent, bool, default = false };
    };
    cpfs {
        counts' = counts;
        other' = other;
        count' = if (counts) then count + 1 else count;
    };
    reward = count;
}
"""

_CHAIN = """
domain chain {
    pvariables {
        first : { state-fluent, bool, default = false };
        second : { state-fluent, bool, default = false };
        third : { state-fluent, bool, default = false };
        go : { action-fluent, bool, default = false };
        act : { action-fluent, bool, default = false };
    };
    cpfs {
        first' = first | third;
        second' = second | go;
        third' = third | second;
    };
    reward = (first | second) * act - 0.125 * go;
}
"""


def _load(folder: Path, name: str, domain: str, **instance: object) -> Problem:
    values = {"non_fluents": "", "start": "", "actions": "pos-inf", "discount": 1.0}
    text = _INSTANCE.format(domain=name, **(values | instance))
    paths = folder / f"{name}.rddl", folder / f"{name}_inst.rddl"
    paths[0].write_text(domain)
    paths[1].write_text(text)
    return load_problem(*map(str, paths))


def lamp(folder: Path, horizon: int, discount: float = 1.0) -> Problem:
    """A bool that may be set by a press that costs an eighth."""
    return _load(folder, "lamp", _LAMP, horizon=horizon, discount=discount)


def gambler(folder: Path, horizon: int) -> Problem:
    """Stakes of one or two until nothing or three are left; a win has the chance 0.4."""
    return _load(folder, "gambler", _GAMBLER, horizon=horizon)


def walk(folder: Path, horizon: int) -> Problem:
    """Three cells in a row; every second step, by chance, is too wet to go."""
    non_fluents = (
        "objects { cell : {c1, c2, c3}; };non-fluents { RIGHT(c1, c2); RIGHT(c2, c3); GOAL(c3); };"
    )
    start = "init-state { at(c1); };"
    return _load(
        folder, "walk", _WALK, horizon=horizon, actions=1, non_fluents=non_fluents, start=start
    )


def shared_draw(folder: Path) -> Problem:
    """Two fluents that read one random fluent, so that they are not independent."""
    return _load(folder, "shared_draw", _SHARED_DRAW, horizon=3)


def one_way(folder: Path, porters: int, places: int, horizon: int) -> Problem:
    """Porters, one action a step, who take coins along a road that nobody goes back on.

    A coin is worth one each time that it is taken, and stays with the chance a half.
    """
    all_porters = [f"r{number}" for number in range(porters)]
    road = [f"p{number}" for number in range(places)]
    links = " ".join(f"NEXT({one}, {other});" for one, other in pairwise(road))
    return _load(
        folder,
        "one_way",
        _ONE_WAY,
        non_fluents=f"objects {{ porter : {{{', '.join(all_porters)}}}; "
        f"place : {{{', '.join(road)}}}; }}; non-fluents {{ {links} }};",
        start=f"init-state {{ {' '.join(f'at({each}, p0);' for each in all_porters)} }};",
        actions=1,
        horizon=horizon,
    )


def counter(folder: Path, horizon: int) -> Problem:
    """A number that grows as long as a bool is true that no reward reads."""
    return _load(folder, "counter", _COUNTER, horizon=horizon)


def chain(folder: Path, horizon: int) -> Problem:
    """Bools that stay true, each made true by another one; the reward needs either of two."""
    return _load(folder, "chain", _CHAIN, horizon=horizon)
