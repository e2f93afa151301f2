"""What a race leaves behind: noise only where the result was trained with it."""

from types import SimpleNamespace

import numpy as np
import pytest

from mdpo_rddl.planner.training.training import Record
from mdpo_rddl.policy.file import SavedPolicy, load_policy
from mdpo_rddl.session.race import Noise
from mdpo_rddl.session.report.race import write_race

POINT = {"arm": "plan", "candidate": "plan", "error": 0.5}
CANDIDATES = [
    {**POINT, "seconds": 1.0, "mean_return": None, "became_incumbent": True},
    {**POINT, "seconds": 2.0, "mean_return": 3.0, "became_incumbent": True},
    {**POINT, "seconds": 4.0, "mean_return": 1.0, "became_incumbent": False},
]
SUMMARY = {
    "label": "a $problem$",
    "horizon": 4,
    "seed": 0,
    "auto": {
        "arm": "plan",
        "noop_return": -1.0,
        "random_return": None,
        "candidates": CANDIDATES,
    },
}
SAVED = SavedPolicy({"w": np.ones(2)}, {}, "", {"label": "p"}, 3)


@pytest.mark.parametrize("noisy", [False, True])
def test_noise_is_written_only_where_the_result_was_trained_with_it(tmp_path, noisy):
    records = tuple(Record(number, 1.0, 2.0, 0.5) for number in (0, 5, 9))
    noise = Noise(records, np.full((3, 4), 0.5)) if noisy else None
    outcome = SimpleNamespace(policy=SimpleNamespace(to_saved=lambda: SAVED), noise=noise)
    write_race(tmp_path, outcome, SUMMARY)
    names = {path.name for path in tmp_path.iterdir()}
    noise = {"noise.npy", "noise.png", "history.csv"} if noisy else set()
    assert names == {"policy.safetensors", "candidates.csv", "learning_curve.png"} | noise
    assert load_policy(tmp_path / "policy.safetensors").seed == 3
    lines = (tmp_path / "candidates.csv").read_text().splitlines()
    assert lines[0] == "seconds,arm,candidate,mean_return,error,became_incumbent"
    assert lines[1:] == [
        "1.0,plan,plan,,0.5,True",
        "2.0,plan,plan,3.0,0.5,True",
        "4.0,plan,plan,1.0,0.5,False",
    ]
    if noisy:
        assert np.load(tmp_path / "noise.npy", allow_pickle=False).shape == (3, 4)


@pytest.mark.filterwarnings("error")
def test_a_race_without_candidates_has_an_empty_picture(tmp_path):
    outcome = SimpleNamespace(policy=SimpleNamespace(to_saved=lambda: SAVED), noise=None)
    race = {**SUMMARY["auto"], "noop_return": None, "candidates": []}
    write_race(tmp_path, outcome, {**SUMMARY, "auto": race})
    assert (tmp_path / "learning_curve.png").stat().st_size > 0
    assert len((tmp_path / "candidates.csv").read_text().splitlines()) == 1
