"""Problems too large to be planned are refused before they are grounded."""

import re
from pathlib import Path

import pytest
from helpers.files import changed
from helpers.mistakes import one_line
from helpers.plan_command import DOMAIN, INSTANCE
from helpers.toys import problem_from

from mdpo_rddl.problem.load import load_problem
from mdpo_rddl.problem.sizes import (
    MOST_GROUND_FLUENTS,
    MOST_PART_VALUES,
    MOST_PLAYED_FLUENTS,
    MOST_VALUES,
    long_integer,
    step_values,
)

SUM = "sum_{?t : tank} [-abs[volume(?t) - LEVEL(?t)]]"


def tanks(count: int) -> str:
    return changed(INSTANCE, "{t1, t2}", "{" + ", ".join(f"t{i + 1}" for i in range(count)) + "}")


def refused(folder: Path, domain: str, instance: str) -> str:
    (folder / "d.rddl").write_text(domain)
    (folder / "i.rddl").write_text(instance)
    said = one_line(lambda: load_problem(str(folder / "d.rddl"), str(folder / "i.rddl")))
    return said


def test_too_many_ground_fluents(tmp_path: Path) -> None:
    domain = changed(
        DOMAIN,
        "LEVEL(tank) :",
        "FAR(tank, tank, tank, tank) : { non-fluent, real, default = 0.0 };\n LEVEL(tank) :",
    )
    said = refused(tmp_path, domain, tanks(40))
    assert said == (
        f"{tmp_path}/i.rddl: {40**4 + 3 * 40:,} ground fluents, "
        f"at most {MOST_GROUND_FLUENTS:,} can be planned for"
    )


@pytest.mark.parametrize("nested", [False, True])
def test_too_many_combinations_of_objects(tmp_path: Path, nested: bool) -> None:
    names = [f"?q{i} : tank" for i in range(8)]
    inner = f"sum_{{{', '.join(names)}}} [1]"
    if nested:
        inner = "".join(f"(1 + sum_{{{name}}} [" for name in names) + "1" + "])" * 8
    said = refused(tmp_path, changed(DOMAIN, "+ fill(?t)", f"+ fill(?t) + {inner}"), tanks(10))
    assert said == (
        f"{tmp_path}/i.rddl: the cpf of volume' ranges over {10**9:,} combinations of objects, "
        f"at most {MOST_VALUES:,} can be planned for"
    )


def test_too_many_values_of_the_parts_together(tmp_path: Path) -> None:
    product = "volume(?a) * volume(?b) * volume(?c)"
    reward = f"sum_{{?a : tank, ?b : tank, ?c : tank}} [{product} + sin[{product}]]"
    said = refused(tmp_path, changed(DOMAIN, SUM, reward), tanks(368))
    # three fluents and two products in each of two terms, the sine and the sum; around them one
    values = 12 * 368**3 + 1
    assert said == (
        f"{tmp_path}/i.rddl: the reward has {values:,} values with all its parts, "
        f"about 2.2 GiB at each step; at most {MOST_PART_VALUES:,} can be planned for"
    )


def test_too_many_fluents_that_a_rollout_carries(tmp_path: Path) -> None:
    leak = "LEAK(tank, tank) : { state-fluent, real, default = 0.0 };\n volume(tank) :"
    domain = changed(DOMAIN, "volume(tank) :", leak)
    said = refused(tmp_path, domain, tanks(1000))
    assert said == (
        f"{tmp_path}/i.rddl: {1000**2 + 2 * 1000:,} ground fluents of state, observation and "
        f"action, at most {MOST_PLAYED_FLUENTS:,} can be planned for"
    )


def test_too_many_values_in_all_steps(tmp_path: Path) -> None:
    domain = changed(DOMAIN, SUM, "sum_{?a : tank, ?b : tank, ?c : tank} [volume(?a)]")
    instance = changed(tanks(100), "horizon = 7;", "horizon = 100000;")
    said = refused(tmp_path, domain, instance)
    assert said.startswith(f"{tmp_path}/i.rddl: the horizon is 100,000, at most ")
    most = re.search(r"at most ([\d,]+) steps", said)
    assert most is not None
    assert said.endswith(f" values can be planned for: --horizon {most[1].replace(',', '')}")


def test_the_reward_and_the_preconditions_are_looked_at_too(tmp_path: Path) -> None:
    ranges = ", ".join(f"?q{i} : tank" for i in range(8))
    domain = changed(DOMAIN, SUM, f"sum_{{{ranges}}} [volume(?q1)]")
    assert "i.rddl: the reward ranges over 100,000,000 comb" in refused(tmp_path, domain, tanks(10))
    domain = changed(
        DOMAIN, "forall_{?t : tank} [fill(?t) >= 0.0]", f"forall_{{{ranges}}} [fill(?q1) >= 0.0]"
    )
    assert "i.rddl: a precondition ranges over" in refused(tmp_path, domain, tanks(10))


@pytest.mark.parametrize("horizon", ["100001", "1000000000", "9" * 25, "9" * 4000])
def test_horizons_that_no_rollout_can_have(tmp_path: Path, horizon: str) -> None:
    instance = changed(INSTANCE, "horizon = 7;", f"horizon = {horizon};")
    said = refused(tmp_path, DOMAIN, instance)
    assert "at most 100,000 steps can be planned for" in said


def test_deep_nesting_is_one_line(tmp_path: Path) -> None:
    deep = "(" * 3000 + "fill(?t)" + ")" * 3000
    for term in (deep, " + ".join(["fill(?t)"] * 3000)):
        said = refused(tmp_path, changed(DOMAIN, "+ fill(?t)", f"+ {term}"), INSTANCE)
        assert said.endswith(
            ": an expression is nested too deeply, or a chain of operators is too long"
        )


def test_a_file_larger_than_any_problem_is_refused_unparsed(tmp_path: Path) -> None:
    said = refused(tmp_path, DOMAIN + "//" + "x" * 2**20, INSTANCE)
    assert said == f"{tmp_path}/d.rddl: is larger than 1 MiB, the most to be read"


def test_a_name_that_is_too_long(tmp_path: Path) -> None:
    long = "t" * 1001
    said = refused(tmp_path, DOMAIN, changed(INSTANCE, "{t1, t2}", f"{{t1, t2, {long}}}"))
    assert said == (
        f"{tmp_path}/i.rddl: a name has 1,001 characters, at most 1,000 can be planned for"
    )


@pytest.mark.parametrize(("rows", "is_planned"), [(500, True), (600, False)])
def test_what_a_determinant_takes(rows: int, is_planned: bool, tmp_path: Path) -> None:
    det = f"({SUM}) + 0 * (det_{{?a : tank, ?b : tank}} [(?a == ?b) * 2.0])"
    domain = changed(DOMAIN, SUM, det)
    if is_planned:
        (tmp_path / "d.rddl").write_text(domain)
        (tmp_path / "i.rddl").write_text(tanks(rows))
        assert load_problem(str(tmp_path / "d.rddl"), str(tmp_path / "i.rddl"))
        return
    said = refused(tmp_path, domain, tanks(rows))
    assert said.startswith(f"{tmp_path}/i.rddl: the reward has 217,")
    assert said.endswith(" at most 200,000,000 can be planned for")


def test_what_an_inverse_takes(tmp_path: Path) -> None:
    inverse = "INV(?a, ?b) = inverse[row=?a, col=?b][(?a == ?b) * 1.0];"
    domain = changed(DOMAIN, "cpfs {", f"cpfs {{ {inverse}")
    fluent = "INV(tank, tank) : { interm-fluent, real };\n LEVEL(tank) :"
    domain = changed(domain, "LEVEL(tank) :", fluent)
    said = refused(tmp_path, domain, tanks(600))
    assert said.startswith(f"{tmp_path}/i.rddl: the cpf of INV has 217,")


def test_what_is_computed_at_a_step_grows_with_the_objects(tmp_path: Path) -> None:
    values = []
    for count in (10, 20):
        (tmp_path / "d.rddl").write_text(DOMAIN)
        (tmp_path / "i.rddl").write_text(tanks(count))
        problem = load_problem(str(tmp_path / "d.rddl"), str(tmp_path / "i.rddl"))
        values.append(step_values(problem.model.ast))
    # what is there once, such as the sum in the reward, is not doubled
    assert 1.8 * values[0] < values[1] < 2 * values[0]


NUMBER = "N : { non-fluent, int, default = -3000000000 };\n LEVEL(tank) :"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (SUM, "sum_{?t : tank} [volume(?t) + 4000000000]", "the reward, "),
        ("+ fill(?t)", "+ min[fill(?t), 2147483648]", "the cpf of volume', "),
        ("LEVEL(tank) :", NUMBER, "the default of N: "),
    ],
)
def test_an_integer_of_more_than_32_bits_is_named(old: str, new: str, said: str) -> None:
    found = long_integer(problem_from(changed(DOMAIN, old, new) + INSTANCE).model.ast)
    assert found is not None
    assert found[0] == "domain"
    assert found[1].startswith(said)
    assert (
        "has more than 32 bits, with which compiled models compute; a real holds it: " in found[1]
    )


def test_an_initial_value_of_more_than_32_bits_is_the_instances() -> None:
    domain = changed(
        DOMAIN, "LEVEL(tank) :", "n : { state-fluent, int, default = 0 };\nLEVEL(tank) :"
    )
    domain = changed(domain, "cpfs {", "cpfs { n' = n;")
    instance = changed(INSTANCE, "volume(t1) = 2.0;", "n = 3000000000;")
    found = long_integer(problem_from(domain + instance).model.ast)
    assert found is not None
    assert found[0] == "instance"
    assert found[1].startswith("the value of n: the integer 3000000000 has more than 32 bits")


def test_an_integer_of_32_bits_and_one_of_a_real_are_none() -> None:
    domain = changed(DOMAIN, "Uniform(0.0, 1.0)", "Uniform(0.0, 2147483647)")
    instance = changed(INSTANCE, "volume(t1) = 2.0", "volume(t1) = 3000000000")
    assert long_integer(problem_from(domain + instance).model.ast) is None
