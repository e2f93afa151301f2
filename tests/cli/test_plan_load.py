"""`mdpo-plan --load`: a saved policy played again."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.files import contents
from helpers.plan_command import INSTANCE, TANKS, Outcome, Run, refuse, run

from mdpo_rddl.policy.file import load_policy, save_policy


def test_a_loaded_policy_earns_the_same_to_the_last_digit(
    finished: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(finished.cwd)
    before = contents(finished.cwd)
    loaded = run(f"{TANKS} --load run --episodes 3 --json", capsys).summary
    figures = ["mean_return", "std_return", "ci95", "returns", "episode_lengths", "illegal_actions"]
    assert {key: loaded[key] for key in figures} == {key: finished.summary[key] for key in figures}
    identity = ["domain", "instance", "horizon", "noise", "noise_parameters", "policy", "seed"]
    assert {key: loaded[key] for key in identity} == {
        key: finished.summary[key] for key in identity
    }
    assert loaded["loaded_from"] == "run"
    assert contents(finished.cwd) == before


def test_a_loaded_policy_with_other_seeds_and_episodes(
    finished: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(finished.cwd)
    fewer = run(f"{TANKS} --load run --episodes 2 --quiet --json", capsys).summary
    assert fewer["returns"] == finished.summary["returns"][:2]
    one = run(f"{TANKS} --load run --episodes 1 --quiet --json", capsys).summary
    assert (one["returns"], one["ci95"], one["std_return"]) == (fewer["returns"][:1], None, 0.0)
    other = run(f"{TANKS} --load run --episodes 2 --seed 1 --quiet --json", capsys).summary
    assert other["seed"] == 1
    assert not set(other["returns"]) & set(fewer["returns"])


def test_a_loaded_policy_plays_another_horizon_where_it_can(
    finished: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(finished.cwd)
    loaded = run(f"{TANKS} --load run --episodes 2 --horizon 4 --quiet --json", capsys).summary
    assert (loaded["horizon"], loaded["episode_lengths"]) == (4, [4, 4])
    with_rest = np.array(finished.summary["returns"][:2])
    assert np.all(np.array(loaded["returns"]) > with_rest)  # each step costs


def test_the_evaluation_of_a_loaded_policy_can_be_kept(
    finished: Run, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = "--episodes 2 --json --out kept/it --movie kept/episode.gif"
    outcome = run(f"{TANKS} --load {finished.folder} {options}", capsys)
    assert (workplace / "kept" / "episode.gif").read_bytes().startswith(b"GIF8")
    assert "written to kept/it" in outcome.out
    files = {"summary.json", "trajectories.npz", "report.html"}
    assert {path.name for path in (workplace / "kept" / "it").iterdir()} == files
    assert json.loads((workplace / "kept/it/summary.json").read_text()) == outcome.summary


def test_quiet_prints_nothing(
    finished: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(finished.cwd)
    assert run(f"{TANKS} --load run --episodes 1 --quiet", capsys) == Outcome(0, "", "")


def damage(path: Path, change: str) -> None:
    data = path.read_bytes()
    match change:
        case "truncated":
            path.write_bytes(data[: len(data) // 2])
        case "changed":
            path.write_bytes(data[:-2] + bytes([data[-2] ^ 1]) + data[-1:])
        case "empty":
            path.write_bytes(b"")
        case "gone":
            path.unlink()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("truncated", "damaged policy file: it has no header"),
        ("changed", "damaged policy file: its contents do not match their digest"),
        ("empty", "damaged policy file: it has no header"),
        ("gone", "no such policy"),
    ],
)
def test_a_damaged_run_folder(
    change: str,
    said: str,
    finished: Run,
    workplace: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shutil.copytree(finished.folder, "run")
    damage(Path("run/policy.safetensors"), change)
    said = f"run/policy.safetensors: {said}"
    refuse(f"{TANKS} --load run --out new", said, workplace, capsys, start=True)


def test_a_policy_of_another_problem(
    finished: Run, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = finished.folder / "policy.safetensors"
    of = f"{policy}: saved for two (tanks/two), not for"
    load = f"--load {finished.folder}"
    said = f"{of} Reservoir_ippc2023-1 (reservoir_control_cont/inst_reservoir_control_cont_1c) "
    refuse(f"Reservoir_ippc2023 1 {load}", said, workplace, capsys, start=True)
    # the same names, but no longer the same problem
    (workplace / "two.rddl").write_text(INSTANCE.replace("LEVEL(t2) = 8.0", "LEVEL(t2) = 9.0"))
    said = f"{of} two (tanks/two) as its files are now"
    refuse(f"{TANKS} {load}", said, workplace, capsys)


def test_the_run_that_is_loaded_is_not_overwritten(
    finished: Run, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(finished.folder, "run")
    said = "run/../run: not overwritten: the policy is loaded from it"
    refuse(f"{TANKS} --load run --out run/../run", said, workplace, capsys)


def test_an_evaluation_alone_cannot_be_loaded(
    finished: Run, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(f"{TANKS} --load {finished.folder} --episodes 1 --quiet --out kept", capsys)
    said = "kept/policy.safetensors: no such policy"
    refuse(f"{TANKS} --load kept", said, workplace, capsys)


def test_the_folder_knows_its_problem(
    finished: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(finished.cwd)
    loaded = run("--load run --episodes 3 --json", capsys).summary
    assert loaded["returns"] == finished.summary["returns"][:3]


def test_a_policy_without_its_problem_asks_for_it(
    finished: Run, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = workplace / "old"
    old.mkdir()
    saved = load_policy(finished.folder / "policy.safetensors")
    save_policy(old / "policy.safetensors", replace(saved, source=None))
    said = (
        "old: holds no RDDL: name its problem as well, as in mdpo-plan DOMAIN INSTANCE --load old"
    )
    refuse("--load old", said, workplace, capsys)
