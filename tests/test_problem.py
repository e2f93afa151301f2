"""Loading a problem, and the one line that each mistake in it gives."""

import hashlib
import logging
import warnings
from pathlib import Path

import numpy as np
import pytest
from files import changed
from mistakes import one_line

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem import Problem, load_problem, make_environment

# The comments and empty lines, which pyRDDLGym's reader removes, shift its line numbers.
DOMAIN = """\
// A few leaking tanks, filled by hand.

domain tanks {

    types {
        tank : object;
    };


    pvariables {
        CAPACITY(tank) : { non-fluent, real, default = 10.0 };  // m^3
        volume(tank) : { state-fluent, real, default = 5.0 };
        // inflow
        fill(tank) : { action-fluent, real, default = 0.0 };
    };

    cpfs {
        volume'(?t) = min[CAPACITY(?t), volume(?t) + fill(?t)] - Uniform(0.0, 1.0);
    };

    reward = sum_{?t : tank} [volume(?t)];

    action-preconditions {
        forall_{?t : tank} [fill(?t) >= 0.0];
        forall_{?t : tank} [fill(?t) <= CAPACITY(?t) - volume(?t)];
    };
}
"""

INSTANCE = """\
// Two tanks.


non-fluents nf_two {
    domain = tanks;
    objects {
        tank : {t1, t2};
    };
    non-fluents {
        CAPACITY(t2) = 8.0;
    };
}


instance two {
    domain = tanks;
    non-fluents = nf_two;
    init-state {
        volume(t1) = 2.0;
    };
    max-nondef-actions = pos-inf;
    horizon = 7;
    discount = 1.0;
}
"""


def write(folder: Path, domain: str = DOMAIN, instance: str = INSTANCE) -> tuple[str, str]:
    (folder / "tanks.rddl").write_text(domain, encoding="utf-8")
    (folder / "two.rddl").write_text(instance, encoding="utf-8")
    return str(folder / "tanks.rddl"), str(folder / "two.rddl")


def load_error(domain: str, instance: str, horizon: int | None = None) -> str:
    return one_line(lambda: load_problem(domain, instance, horizon))


def episode(problem: Problem, seed: int) -> list[float]:
    env = make_environment(problem)
    env.reset(seed=seed)
    done, rewards = False, []
    while not done:
        _, reward, terminated, truncated, _ = env.step({"fill": np.array([0.5, 0.25])})
        rewards.append(float(reward))
        done = terminated or truncated
    return rewards


# --- problems that load -------------------------------------------------------------------


def test_two_files(tmp_path: Path) -> None:
    domain, instance = write(tmp_path)
    problem = load_problem(domain, instance)
    assert (problem.domain_name, problem.instance_name, problem.label) == ("tanks", "two", "two")
    assert (problem.domain_path, problem.instance_path) == (Path(domain), Path(instance))
    assert problem.horizon == problem.model.horizon == 7
    assert problem.model.state_fluents["volume"] == [2.0, 5.0]
    assert problem.digest == hashlib.sha256((DOMAIN + INSTANCE).encode()).hexdigest()


def test_relative_paths_without_separator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path)
    (tmp_path / "tanks.rddl").rename(tmp_path / "tanks")
    monkeypatch.chdir(tmp_path)
    assert load_problem("tanks", "two.rddl").instance_path == Path("two.rddl")


def test_windows_line_ends_and_byte_order_mark_change_nothing(tmp_path: Path) -> None:
    plain = load_problem(*write(tmp_path))
    (tmp_path / "tanks.rddl").write_bytes(b"\xef\xbb\xbf" + DOMAIN.replace("\n", "\r\n").encode())
    windows = load_problem(str(tmp_path / "tanks.rddl"), str(tmp_path / "two.rddl"))
    assert windows.digest == plain.digest


def test_undecodable_byte_in_a_comment_is_accepted(tmp_path: Path) -> None:
    domain, instance = write(tmp_path)
    Path(domain).write_bytes(DOMAIN.encode().replace(b"// inflow", b"// d\xe9bit"))
    assert load_problem(domain, instance).domain_name == "tanks"


def test_domain_block_in_the_instance_file_is_not_used(tmp_path: Path) -> None:
    other_domain = changed(DOMAIN, "default = 5.0", "default = 9.0")
    domain, instance = write(tmp_path, instance=other_domain + INSTANCE)
    assert load_problem(domain, instance).model.variable_defaults["volume"] == 5.0


def test_problem_of_rddlrepository() -> None:
    problem = load_problem("Reservoir_ippc2023", "1")
    assert problem.label == "Reservoir_ippc2023-1"
    assert problem.domain_path.name == "domain.rddl"
    assert problem.instance_path.name == "instance1.rddl"
    assert problem.domain_name in problem.domain_path.read_text()
    assert make_environment(problem).action_space["release"].shape[0] > 1


def test_pair_of_rddlrepository_with_different_names_loads() -> None:
    assert load_problem("Bicycle_physics", "0").domain_name == "Bicycle"


def test_horizon_override(tmp_path: Path) -> None:
    problem = load_problem(*write(tmp_path), horizon=3)
    assert problem.horizon == make_environment(problem).horizon == 3
    assert len(episode(problem, seed=0)) == 3


def test_horizon_override_replaces_an_infinite_horizon(tmp_path: Path) -> None:
    instance = changed(INSTANCE, "horizon = 7", "horizon = pos-inf")
    assert load_problem(*write(tmp_path, instance=instance), horizon=4).horizon == 4


def test_seeded_episode_is_reproducible(tmp_path: Path) -> None:
    problem = load_problem(*write(tmp_path))
    assert len(episode(problem, seed=3)) == 7
    assert episode(problem, seed=3) == episode(problem, seed=3)
    assert episode(problem, seed=3) != episode(problem, seed=4)


def test_environments_of_one_problem_are_independent(tmp_path: Path) -> None:
    problem = load_problem(*write(tmp_path))
    expected = episode(problem, seed=3)
    env = make_environment(problem)
    env.reset(seed=3)
    rewards = []
    for _ in range(7):
        rewards.append(float(env.step({"fill": np.array([0.5, 0.25])})[1]))
        episode(problem, seed=5)
    assert rewards == expected
    first, second = make_environment(problem), make_environment(problem)
    assert first.sampler.rng is not second.sampler.rng


def test_action_constraints_are_enforced_on_demand(tmp_path: Path) -> None:
    problem = load_problem(*write(tmp_path))
    too_much = {"fill": np.array([99.0, 0.0])}
    lenient, strict = make_environment(problem), make_environment(problem, True)
    lenient.reset(seed=0)
    lenient.step(too_much)
    strict.reset(seed=0)
    with pytest.raises(ValueError, match="Precondition"):
        strict.step(too_much)


def test_loading_writes_no_file_and_says_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    recwarn: pytest.WarningsRecorder,
    caplog: pytest.LogCaptureFixture,
) -> None:
    # pyRDDLGym warns of the second precondition, and prints that it overrides nf_two.
    inner = "objects { tank : {t1, t2}; };\n    non-fluents { CAPACITY(t2) = 8.0; };\n"
    instance = changed(INSTANCE, "    init-state {", inner + "    init-state {")
    instance = instance[instance.index("instance two") :]
    domain_path, instance_path = write(tmp_path, instance=instance)
    working, package = tmp_path / "working", Path(load_problem.__code__.co_filename).parent
    working.mkdir()
    monkeypatch.chdir(working)
    warnings.simplefilter("error")
    caplog.set_level(logging.DEBUG)

    load_problem(domain_path, instance_path)

    assert capfd.readouterr() == ("", "")
    assert list(recwarn) == []
    assert list(working.iterdir()) == []
    assert not {"parsetab.py", "parser.out"} & {path.name for path in package.iterdir()}
    assert "Action precondition 2" in caplog.text
    assert "parser will override" in caplog.text


# --- files that cannot be read ------------------------------------------------------------


@pytest.mark.parametrize(("missing", "role"), [("tanks.rddl", "domain"), ("two.rddl", "instance")])
def test_missing_file(tmp_path: Path, missing: str, role: str) -> None:
    domain, instance = write(tmp_path)
    (tmp_path / missing).unlink()
    assert load_error(domain, instance) == (
        f"{tmp_path / missing}: cannot read the {role} file: No such file or directory"
    )


def test_name_and_file_are_taken_as_two_files(tmp_path: Path) -> None:
    _, instance = write(tmp_path)
    message = load_error("HVAC_ippc2023", instance)
    assert message.startswith("HVAC_ippc2023: cannot read the domain file: No such file")


def test_directory(tmp_path: Path) -> None:
    domain, _ = write(tmp_path)
    message = load_error(domain, str(tmp_path))
    assert message == f"{tmp_path}: cannot read the instance file: Is a directory"


def test_no_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    domain, instance = write(tmp_path)

    def refuse(*_: object, **__: object) -> str:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_text", refuse)  # A mode does not stop the superuser.
    assert load_error(domain, instance) == (
        f"{domain}: cannot read the domain file: Permission denied"
    )


def test_not_utf8(tmp_path: Path) -> None:
    domain, instance = write(tmp_path)
    Path(instance).write_bytes(INSTANCE.encode().replace(b"volume(t1)", b"lev\xe9l(t1)"))
    assert load_error(domain, instance) == f"{instance}:19: not UTF-8 text"


# --- syntax -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "line", "cause"),
    [
        ("default = 10.0 };", "default = 10.0 }", 12, " at 'volume' (or at the end of line 11)"),
        (
            "[volume(?t)];",
            "[volume(?t)]",
            23,
            " at the keyword 'action-preconditions' (or at the end of line 21)",
        ),
        (
            "volume(tank) :",
            "level(tank) :",
            12,
            " at the keyword 'level' (or at the end of line 11)",
        ),
        ("state-fluent", "state-fluid", 12, " at 'state-fluid'"),
        ("fill(?t)] -", "fill(?t) -", 18, " at ';'"),
        ("    cpfs {\n", "", 17, " at 'volume'' (or at the end of line 15)"),
        ("1.0);\n    };", "1.0);", 20, " at the keyword 'reward' (or at the end of line 18)"),
        ("domain tanks", "tanks", 3, " at 'tanks'"),
        ("    };\n}\n", "    };\n", 26, ": the file ends inside a block"),
    ],
)
def test_syntax_error_in_domain(tmp_path: Path, old: str, new: str, line: int, cause: str) -> None:
    domain, instance = write(tmp_path, domain=changed(DOMAIN, old, new))
    message = load_error(domain, instance)
    assert message == f"{domain}:{line}: syntax error{cause}"


@pytest.mark.parametrize(
    ("old", "new", "line", "cause"),
    [
        ("t1, t2};", "t1, t2}", 8, " at '}' (or at the end of line 7)"),
        ("horizon =", "horizont =", 22, " at 'horizont' (or at the end of line 21)"),
        ("discount = 1.0", "discount = 1", 23, " at '1'"),
        (
            "};\n}\n\n\ninstance",
            "};\n\n\ninstance",
            14,
            " at the keyword 'instance' (or at the end of line 11)",
        ),
        ("1.0;\n}", "1.0;", 23, ": the file ends inside a block"),
    ],
)
def test_syntax_error_in_instance(
    tmp_path: Path, old: str, new: str, line: int, cause: str
) -> None:
    domain, instance = write(tmp_path, instance=changed(INSTANCE, old, new))
    message = load_error(domain, instance)
    assert message == f"{instance}:{line}: syntax error{cause}"


def test_illegal_character(tmp_path: Path) -> None:
    domain, instance = write(tmp_path, domain=changed(DOMAIN, "reward =", "reward !="))
    assert load_error(domain, instance) == f"{domain}:21: illegal character '!'"


def test_number_that_python_refuses(tmp_path: Path) -> None:
    domain, instance = write(tmp_path, domain=changed(DOMAIN, "10.0", "1" * 5000))
    assert load_error(domain, instance).startswith(f"{domain}: ValueError: Exceeds the limit")


def test_empty_files(tmp_path: Path) -> None:
    domain, instance = write(tmp_path, domain="")
    assert load_error(domain, instance) == f"{domain}: the domain file has no domain block"
    domain, instance = write(tmp_path, instance="// nothing\n")
    assert load_error(domain, instance) == f"{instance}: the instance file has no instance block"


def test_swapped_files(tmp_path: Path) -> None:
    domain, instance = write(tmp_path)
    message = load_error(instance, domain)
    assert message.startswith(f"{instance}: the domain file has no domain block")
    assert message.endswith("an instance block: are the two files swapped?")


@pytest.mark.parametrize(
    ("start", "end", "section"),
    [
        ("    reward", "    action-pre", "reward"),
        ("    cpfs", "    reward", "cpfs"),
        ("    pvariables", "    cpfs", "pvariables"),
    ],
)
def test_missing_section_of_domain(tmp_path: Path, start: str, end: str, section: str) -> None:
    text = DOMAIN[: DOMAIN.index(start)] + DOMAIN[DOMAIN.index(end) :]
    domain, instance = write(tmp_path, domain=text)
    assert load_error(domain, instance) == f"{domain}: the section {section} is missing"


def test_missing_non_fluents_block(tmp_path: Path) -> None:
    text = INSTANCE[INSTANCE.index("instance two") :]
    domain, instance = write(tmp_path, instance=text)
    assert load_error(domain, instance) == f"{instance}: the file has no non-fluents block"


@pytest.mark.parametrize(
    ("old", "section"), [("horizon = 7;", "horizon"), ("discount = 1.0;", "discount")]
)
def test_missing_section_of_instance(tmp_path: Path, old: str, section: str) -> None:
    domain, instance = write(tmp_path, instance=changed(INSTANCE, old, ""))
    assert load_error(domain, instance) == f"{instance}: instance 'two' has no {section}"


# --- names that do not fit ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        (
            "{\n    domain = tanks;\n    non-fluents =",
            "{\n    domain = lakes;\n    non-fluents =",
            "instance 'two' is for domain 'lakes', but {domain} defines 'tanks'",
        ),
        (
            "{\n    domain = tanks;\n    objects",
            "{\n    domain = lakes;\n    objects",
            "non-fluents 'nf_two' are for domain 'lakes', but {domain} defines 'tanks'",
        ),
        (
            "non-fluents = nf_two",
            "non-fluents = nf_ten",
            "instance 'two' is for non-fluents 'nf_ten', but the file defines 'nf_two'",
        ),
    ],
)
def test_instance_of_another_domain(tmp_path: Path, old: str, new: str, cause: str) -> None:
    domain, instance = write(tmp_path, instance=changed(INSTANCE, old, new))
    assert load_error(domain, instance) == f"{instance}: {cause.format(domain=domain)}"


def test_unknown_problem_suggests_close_names() -> None:
    message = load_error("HVAC_ipc2023", "1")
    assert message.startswith("'HVAC_ipc2023' is neither a file nor a problem of rddlrepository")
    assert "HVAC_ippc2023" in message


def test_unknown_problem_with_no_close_name() -> None:
    message = load_error("qqqqqqqqqqqq", "1")
    assert message == "'qqqqqqqqqqqq' is neither a file nor a problem of rddlrepository"


def test_unknown_instance_lists_those_available() -> None:
    assert load_error("Reservoir_ippc2023", "99") == (
        "'99' is neither a file nor an instance of the rddlrepository problem "
        "'Reservoir_ippc2023', which has: 1 2 3 4 5"
    )


# --- meaning ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        ("[volume(?t)];", "[depth(?t)];", "depth"),
        ("[volume(?t)];", "[volume(?t, ?t)];", "volume"),
        ("[volume(?t)];", "[volume(?u)];", "?u"),
        ("volume(?t) + fill", "volume(?t) + fil", "fil"),
        ("min[CAPACITY(?t), ", "minn[CAPACITY(?t), ", "minn"),
        ("[fill(?t) >= 0.0]", "[fill(?t) + 1.0]", "forall"),
        ("- Uniform", "+ (volume(?t) ^ true) - Uniform", "^"),
        ("volume'(?t) =", "volume'(?t, ?u) =", "volume'"),
        ("volume'(?t) =", "depth'(?t) =", "depth'"),
        ("// inflow", "volume(tank) : { state-fluent, real, default = 1.0 };", "<volume>"),
        ("// inflow", "depth(tank) : { state-fluent, real, default = 1.0 };", "<depth'>"),
        ("// inflow", "depth(pool) : { non-fluent, real, default = 1.0 };", "pool"),
        ("default = 5.0", "default = @five", "five"),
        ("tank : object;", "tank : object; pool : object;", "<pool>"),
        ("[fill(?t) >= 0.0]", "[fill(?t) >= 20.0 ^ fill(?t) <= 1.0]", "Bounds"),
    ],
)
def test_mistake_in_the_meaning_of_the_domain(
    tmp_path: Path, old: str, new: str, cause: str
) -> None:
    domain, instance = write(tmp_path, domain=changed(DOMAIN, old, new))
    message = load_error(domain, instance)
    assert message.startswith(f"{domain}, {instance}: ")
    assert cause in message


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        ("volume(t1) = 2.0", "depth(t1) = 2.0", "<depth>"),
        ("volume(t1) = 2.0", "volume(t3) = 2.0", "t3"),
        ("volume(t1) = 2.0", "volume(t1, t2) = 2.0", "<volume>"),
        ("CAPACITY(t2)", "SIZE(t2)", "<SIZE>"),
        ("{t1, t2}", "{t1, t1}", "<t1>"),
    ],
)
def test_mistake_in_the_meaning_of_the_instance(
    tmp_path: Path, old: str, new: str, cause: str
) -> None:
    domain, instance = write(tmp_path, instance=changed(INSTANCE, old, new))
    message = load_error(domain, instance)
    assert message.startswith(f"{domain}, {instance}: ")
    assert cause in message


def test_original_error_is_chained(tmp_path: Path) -> None:
    domain, instance = write(tmp_path, domain=changed(DOMAIN, "[volume(?t)];", "[depth(?t)];"))
    with pytest.raises(InputError) as caught:
        load_problem(domain, instance)
    assert type(caught.value.__cause__).__module__.startswith("pyRDDLGym")


@pytest.mark.parametrize("horizon", [0, -3, True, 2.5])
def test_horizon_option_is_not_a_positive_integer(tmp_path: Path, horizon: int) -> None:
    domain, instance = write(tmp_path)
    assert load_error(domain, instance, horizon) == (
        f"--horizon must be a positive integer, got {horizon}"
    )


@pytest.mark.parametrize("horizon", ["0", "pos-inf"])
def test_horizon_of_the_instance_is_not_a_positive_integer(tmp_path: Path, horizon: str) -> None:
    text = changed(INSTANCE, "horizon = 7", f"horizon = {horizon}")
    domain, instance = write(tmp_path, instance=text)
    assert load_error(domain, instance) == (
        f"{instance}: the horizon must be a positive integer, got {horizon}"
    )
