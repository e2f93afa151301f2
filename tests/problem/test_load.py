"""Loading a problem."""

import hashlib
import logging
import warnings
from pathlib import Path

import numpy as np
import pytest
from helpers.files import changed
from helpers.tanks import DOMAIN, INSTANCE, write

from mdpo_rddl.problem.load import Problem, load_problem, make_environment


def episode(problem: Problem, seed: int) -> list[float]:
    env = make_environment(problem)
    env.reset(seed=seed)
    done, rewards = False, []
    while not done:
        _, reward, terminated, truncated, _ = env.step({"fill": np.array([0.5, 0.25])})
        rewards.append(float(reward))
        done = terminated or truncated
    return rewards


def test_two_files(tmp_path: Path) -> None:
    domain, instance = write(tmp_path)
    problem = load_problem(domain, instance)
    assert (problem.domain_name, problem.instance_name, problem.label) == ("tanks", "two", "two")
    assert (problem.domain_path, problem.instance_path) == (Path(domain), Path(instance))
    assert problem.horizon == problem.model.horizon == 7
    assert problem.model.state_fluents["volume"] == [2.0, 5.0]
    assert problem.digest == hashlib.sha256((DOMAIN + INSTANCE).encode()).hexdigest()


def test_one_file_with_the_domain_and_the_instance(tmp_path: Path) -> None:
    path = tmp_path / "whole.rddl"
    path.write_text(DOMAIN + INSTANCE)
    problem = load_problem(str(path))
    assert (problem.domain_name, problem.instance_name, problem.label) == ("tanks", "two", "whole")
    assert problem.domain_path == problem.instance_path == path
    assert episode(problem, 3) == episode(load_problem(*write(tmp_path)), 3)


def test_relative_paths_without_separator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path)
    (tmp_path / "tanks.rddl").rename(tmp_path / "tanks")
    monkeypatch.chdir(tmp_path)
    assert load_problem("tanks", "two.rddl").instance_path == Path("two.rddl")


def test_windows_line_ends_and_byte_order_marks_change_nothing(tmp_path: Path) -> None:
    plain = load_problem(*write(tmp_path))
    marks = b"\xef\xbb\xbf" * 2  # an editor may have put one before another's
    (tmp_path / "tanks.rddl").write_bytes(marks + DOMAIN.replace("\n", "\r\n").encode())
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
