"""Every kind of expression against pyRDDLGym's environment, on problems of a few objects."""

import numpy as np
import pytest
from benchmarks.simulator_law import QUANTILES, compare
from helpers.toys import problem_from

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.simulator.simulator import Simulator

# what is read: A and M constants, x, s, k, b and c of the state, push and set actions
FLUENTS = """
  types { item : object; color : {@red, @green, @blue}; };
  pvariables {
    A(item) : { non-fluent, real, default = 1.5 };
    LINK(item, item) : { non-fluent, bool, default = false };
    W(color) : { non-fluent, real, default = 0.25 };
    GOAL(item) : { non-fluent, item, default = @undefined };
    x(item) : { state-fluent, real, default = 0.5 };
    m(item, item) : { state-fluent, real, default = 0.1 };
    k(item) : { state-fluent, int, default = 2 };
    b(item) : { state-fluent, bool, default = true };
    c(item) : { state-fluent, color, default = @green };
    who(item) : { state-fluent, item, default = @undefined };
    s : { state-fluent, real, default = 1.0 };
    push(item) : { action-fluent, real, default = 0.0 };
    set(item) : { action-fluent, bool, default = false };
    paint(item) : { action-fluent, color, default = @red };
    y(item) : { interm-fluent, real };
    n(item) : { interm-fluent, int };
    t(item) : { interm-fluent, bool };
    q(item) : { interm-fluent, color };
  };
"""


def toy(reward: str, cpfs: str = "", **parts: str) -> str:
    """A domain whose reward, or one of whose fluents, is what a test is about."""
    own = {
        "y(?i)": "0.0",
        "n(?i)": "0",
        "t(?i)": "false",
        "q(?i)": "@red",
        "x'(?i)": "x(?i) + push(?i)",
        "m'(?i, ?j)": "m(?i, ?j) + 0.1 * push(?i) * A(?j)",
        "k'(?i)": "if (set(?i)) then k(?i) + 1 else k(?i) - 1",
        "b'(?i)": "b(?i) ~ set(?i)",
        "c'(?i)": "paint(?i)",
        "who'(?i)": "who(?i)",
        "s'": "s + sum_{?i: item} [push(?i)]",
    }
    for line in filter(None, (each.strip() for each in cpfs.split(";"))):
        name, _, value = line.partition("=")
        own[name.strip()] = value.strip()
    rules = "".join(f"{name} = {value};\n" for name, value in own.items())
    blocks = "".join(
        f"{name.replace('_', '-')} {{ {text} }};\n" for name, text in parts.items()
    )
    return (
        f"domain toy {{ {FLUENTS} cpfs {{ {rules} }};\n reward = {reward}; {blocks} }}\n"
        "non-fluents nf { domain = toy; objects { item : {i1, i2, i3}; };\n"
        "  non-fluents { A(i2) = 2.5; LINK(i1, i2); LINK(i2, i3); W(@blue) = 0.5; }; }\n"
        "instance one { domain = toy; non-fluents = nf; init-state { x(i2) = 1.25; k(i3) = 5;\n"
        "  ~b(i2); c(i1) = @blue; m(i1, i1) = 2.0; m(i2, i2) = 3.0; m(i3, i3) = 1.0; };\n"
        "  max-nondef-actions = pos-inf; horizon = 6; discount = 0.9; }\n"
    )
