"""What stands in RDDL files without effect: which block, where, and what to do."""

from pathlib import Path

import pytest
from helpers.files import changed
from helpers.mistakes import one_line
from helpers.tanks import DOMAIN, INSTANCE, write

from mdpo_rddl.problem.load import load_problem

LIMITS = "    state-action-constraints {\n        forall_{?t : tank} [fill(?t) <= 1.0];\n    };\n"
POLICY = """\
policy filler {
    domain = tanks;
    pvariables { GAIN : { param-fluent, real, default = 1.0 }; };
    cpfs { fill(?t) = GAIN; };
}
"""
OTHER = "non-fluents nf_one {\n    domain = tanks;\n    objects { tank : {t1}; };\n}\n"


def warned(folder: Path, domain: str = DOMAIN, instance: str = INSTANCE) -> tuple[str, ...]:
    return load_problem(*write(folder, domain=domain, instance=instance)).warnings


def line_of(text: str, part: str) -> int:
    return text[: text.index(part)].count("\n") + 1


def test_of_a_usual_problem_there_is_nothing_to_say(tmp_path: Path) -> None:
    assert warned(tmp_path) == ()


def test_state_action_constraints_are_ignored_and_that_is_said(tmp_path: Path) -> None:
    domain = changed(DOMAIN, "    action-preconditions", LIMITS + "    action-preconditions")
    line = line_of(domain, "state-action-constraints")
    (said,) = warned(tmp_path, domain)
    assert said == (
        f"{tmp_path}/tanks.rddl:{line}: the block state-action-constraints of domain tanks is "
        "ignored, as pyRDDLGym does: limits of actions belong in action-preconditions, limits of "
        "states in state-invariants"
    )


def test_an_empty_block_is_no_loss(tmp_path: Path) -> None:
    empty = "    state-action-constraints { };\n    action-preconditions { };\n"
    domain = changed(DOMAIN, "    action-preconditions", empty + "    action-preconditions")
    assert warned(tmp_path, domain) == ()


@pytest.mark.parametrize(
    ("again", "section"),
    [
        ("action-preconditions { forall_{?t : tank} [fill(?t) <= 1.0]; };", "action-preconditions"),
        ("reward = 1.0;", "reward"),
        ("cdfs { volume'(?t) = 1.0; };", "cpfs"),
    ],
)
def test_of_two_sections_the_last_one_counts(tmp_path: Path, again: str, section: str) -> None:
    domain = changed(DOMAIN, "    cpfs {", f"    {again}\n    cpfs {{")
    at, later = line_of(domain, again), DOMAIN.index(f"    {section}")
    (said,) = warned(tmp_path, domain)
    begun = f"{tmp_path}/tanks.rddl:{at}: {section} of domain tanks is ignored"
    assert said.startswith(begun)
    assert f"again in line {DOMAIN[:later].count(chr(10)) + 2}," in said


def test_a_policy_block_is_ignored(tmp_path: Path) -> None:
    (said,) = warned(tmp_path, instance=INSTANCE + POLICY)
    line = line_of(INSTANCE + POLICY, "policy filler")
    assert said.startswith(f"{tmp_path}/two.rddl:{line}: the policy block filler is ignored")


@pytest.mark.parametrize("text", [OTHER + INSTANCE, INSTANCE + OTHER])
def test_of_two_non_fluents_those_count_that_the_instance_is_for(tmp_path: Path, text: str) -> None:
    problem = load_problem(*write(tmp_path, instance=text))
    assert problem.model.type_to_objects["tank"] == ["t1", "t2"]
    one, two = (line_of(text, f"non-fluents {name} {{") for name in ("nf_one", "nf_two"))
    path = f"{tmp_path}/two.rddl"
    assert problem.warnings == (
        f"{path}:{one}: the non-fluents block nf_one is ignored: nf_two counts, which instance "
        f"two is for ({path}:{two})",
    )


def test_non_fluents_of_the_domains_file_are_found(tmp_path: Path) -> None:
    text = INSTANCE[: INSTANCE.index("instance two")]
    rest = INSTANCE[INSTANCE.index("instance two") :]
    problem = load_problem(*write(tmp_path, domain=DOMAIN + text, instance=OTHER + rest))
    assert problem.model.type_to_objects["tank"] == ["t1", "t2"]
    assert len(problem.warnings) == 1


def test_where_the_instance_has_its_own_non_fluents_the_others_are_ignored(tmp_path: Path) -> None:
    own = "objects { tank : {t1, t2, t3}; };\n    non-fluents { CAPACITY(t2) = 8.0; };\n"
    text = changed(INSTANCE, "non-fluents = nf_two;", own)
    problem = load_problem(*write(tmp_path, instance=text))
    assert problem.model.type_to_objects["tank"] == ["t1", "t2", "t3"]
    (said,) = problem.warnings
    assert "the non-fluents block nf_two is ignored: those in the instance block count" in said


def test_an_initial_state_that_breaks_an_invariant_is_pointed_out(tmp_path: Path) -> None:
    invariant = "    state-invariants { forall_{?t : tank} [volume(?t) >= 4.0]; };\n"
    domain = changed(DOMAIN, "    action-preconditions", invariant + "    action-preconditions")
    (said,) = warned(tmp_path, domain)
    assert said.startswith(f"{tmp_path}/two.rddl: the initial state breaks the state invariant ")
    assert "volume(?t) >= 4.0" in said


def test_a_single_file_without_a_domain_asks_for_one(tmp_path: Path) -> None:
    path = tmp_path / "two.rddl"
    path.write_text(INSTANCE)
    assert one_line(lambda: load_problem(str(path))) == (
        f"{path}: the domain file has no domain block: give the domain's file before it"
    )
