"""The one line that each mistake in a problem gives."""

from pathlib import Path

import pytest
from helpers.files import changed
from helpers.mistakes import one_line
from helpers.tanks import DOMAIN, INSTANCE, write

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem import files
from mdpo_rddl.problem.load import load_problem


def load_error(domain: str, instance: str, horizon: int | None = None) -> str:
    return one_line(lambda: load_problem(domain, instance, horizon))


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

    def refuse(*_: object, **__: object) -> bytes:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(files, "read_bounded", refuse)  # A mode does not stop the superuser.
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
    said = load_error(domain, instance)
    assert said == f"{domain}: the domain file has no domain block: it begins with `domain NAME {{`"
    domain, instance = write(tmp_path, instance="// nothing\n")
    assert load_error(domain, instance) == (
        f"{instance}: the instance file has no instance block: add `instance NAME {{ domain = "
        "tanks; non-fluents = NF; horizon = 40; discount = 1.0; }`"
    )


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
    said = load_error(domain, instance)
    begun = f"{domain}: the section {section} of domain tanks is missing: add `{section} "
    assert said.startswith(begun)


def test_missing_non_fluents_block(tmp_path: Path) -> None:
    text = INSTANCE[INSTANCE.index("instance two") :]
    domain, instance = write(tmp_path, instance=text)
    assert load_error(domain, instance) == (
        f"{instance}: the file has no non-fluents block: add `non-fluents nf_two {{ domain = "
        "tanks; }`"
    )


@pytest.mark.parametrize(
    ("old", "section", "line"),
    [
        ("horizon = 7;", "horizon", "horizon = 40;"),
        ("discount = 1.0;", "discount", "discount = 1.0;"),
    ],
)
def test_missing_section_of_instance(tmp_path: Path, old: str, section: str, line: str) -> None:
    domain, instance = write(tmp_path, instance=changed(INSTANCE, old, ""))
    assert load_error(domain, instance) == (
        f"{instance}: instance 'two' has no {section}: add `{line}`"
    )


def test_missing_objects(tmp_path: Path) -> None:
    domain, instance = write(
        tmp_path, domain=changed(DOMAIN, "tank : object;", "tank : object; pool : object;")
    )
    assert load_error(domain, instance) == (
        f"{instance}: the type pool has no objects: add `objects {{ pool : {{pool1}}; }};` to the "
        "non-fluents block nf_two"
    )


def test_objects_in_the_instance_are_pointed_out(tmp_path: Path) -> None:
    objects = "objects {\n        tank : {t1, t2};\n    };\n"
    text = changed(INSTANCE, objects, "")
    text = changed(text, "init-state", objects + "    init-state")
    said = load_error(*write(tmp_path, instance=text))
    assert "the type tank has no objects" in said
    assert "objects belong in the non-fluents block" in said


def test_one_file_is_named_once(tmp_path: Path) -> None:
    path = tmp_path / "both.rddl"
    path.write_text(changed(DOMAIN, "volume'(?t) =", "depth'(?t) =") + INSTANCE)
    said = one_line(lambda: load_problem(str(path)))
    assert said.startswith(f"{path}: ")
    assert said.count(str(path)) == 1


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
    assert message == (
        "'qqqqqqqqqqqq' is neither a file nor a problem of rddlrepository "
        "(mdpo-plan --list shows all)"
    )


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
