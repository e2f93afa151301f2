"""What a race leaves behind is what the next one begins with."""

import json

import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.tanks import DOMAIN, INSTANCE
from helpers.toys import problem_from

from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.policy.container import read_container, write_container
from mdpo_rddl.policy.formula import FeedbackFormula
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.race.arm import Candidate
from mdpo_rddl.race.outcome import Point
from mdpo_rddl.session import race_progress
from mdpo_rddl.session.race_progress import RaceProgress
from mdpo_rddl.session.requests import PlanRequest

PROBLEM = problem_from(DOMAIN + INSTANCE, horizon=4)
CONFIG = PRESETS["auto"]("tanks").without_section("Search")
FORMULA = FeedbackFormula(PROBLEM, CONFIG)
NEVER = 1e9


def request(tmp_path, seed=3):
    return PlanRequest(PROBLEM, CONFIG, "auto", seed, 2, tmp_path / "run")


def point(mean, seconds, became_incumbent=True, arm="plans"):
    params = FORMULA.actions.feedback.initial(np.random.default_rng(0))
    params["own"]["fill"]["bias"] += mean
    policy = Policy(PROBLEM, CONFIG, params, {}, 3)
    candidate = Candidate(arm, "a plan", policy, ("rules",), uses_noise=True)
    returns = np.array([mean - 1.0, mean + 1.0])
    return Point(candidate, returns, seconds, became_incumbent)


def kept(tmp_path, *points, used=9.0):
    progress = RaceProgress(tmp_path, request(tmp_path), NEVER)
    for each in points:
        progress.judged(each)
    progress.save(used)
    return RaceProgress(tmp_path, request(tmp_path), NEVER).start


def test_nothing_is_there_before_the_first_candidate(tmp_path):
    start = kept(tmp_path)
    assert (start.candidates, start.curve, start.seconds) == ((), (), 0.0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.filterwarnings("ignore:invalid value")  # of what has diverged
def test_the_best_policy_of_each_arm_comes_back_the_incumbent_first(tmp_path):
    points = [
        point(-6.0, 1.0, arm="rules"),
        point(-5.0, 2.0),
        point(-9.0, 3.0, False),
        point(-7.0, 4.0, False, arm="rules"),
        point(-np.inf, 5.0, False, arm="greedy"),
    ]
    start = kept(tmp_path, *points)
    first, second = start.candidates
    assert (first.arm, first.label, first.parents, first.uses_noise) == (
        "plans",
        "a plan",
        ("rules",),
        True,
    )
    assert second.arm == "rules"
    bias = [one.policy.params["own"]["fill"]["bias"].tolist() for one in (first, second)]
    assert bias == [[-5.0, -5.0], [-6.0, -6.0]]
    assert start.seconds == 9.0
    assert [each["mean_return"] for each in start.curve] == [-6.0, -5.0, -9.0, -7.0, None]
    assert start.curve[1] == points[1].figures()


def test_the_curve_goes_on(tmp_path):
    kept(tmp_path, point(-5.0, 1.0))
    start = kept(tmp_path, point(-5.0, 2.5), point(-3.0, 4.0))
    assert [each["seconds"] for each in start.curve] == [1.0, 2.5, 4.0]


def test_of_a_long_curve_the_incumbents_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(race_progress, "_MOST_POINTS", 3)
    start = kept(tmp_path, *(point(float(n), float(n), n % 2 == 0) for n in range(5)))
    assert [each["seconds"] for each in start.curve] == [0.0, 2.0, 4.0]


def test_files_are_written_now_and_then(tmp_path, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(race_progress.time, "monotonic", lambda: now[0])
    progress = RaceProgress(tmp_path, request(tmp_path), 60.0)
    progress.judged(point(-5.0, 0.1))
    written = []

    def write(tensors, text):
        written.append(now[0])
        now[0] += 0.5  # so long does it take

    monkeypatch.setattr(progress._kept, "write", write)
    for second in range(200):
        now[0] = max(now[0], float(second))
        progress.pulse(now[0])
        if second == 5:
            progress.judged(point(-4.0, 5.0))
    # with the first incumbent after a second, with the next one once the first took a twentieth of
    # the time, and then from minute to minute
    assert written == [1.0, 12.0, 73.0, 134.0, 195.0]


def damaged(tmp_path, **changes):
    kept(tmp_path, point(-5.0, 1.0))
    (path,) = tmp_path.glob("*.safetensors")
    text, tensors = read_container(path, ("mdpo-rddl race 5",))
    about = {**json.loads(text["race"]), **changes}
    write_container(path, tensors, {**text, "race": json.dumps(about)})
    return one_line(lambda: RaceProgress(tmp_path, request(tmp_path), NEVER))


@pytest.mark.parametrize(
    "changes",
    [
        {"seconds": -1.0},
        {"seconds": float("nan")},
        {"curve": [{"seconds": 1.0}]},
        {"curve": 3},
        {"candidates": [{"arm": "a"}]},
        {"candidates": 7},
    ],
)
def test_what_is_damaged_is_told_in_a_line(tmp_path, changes):
    assert "damaged checkpoint" in damaged(tmp_path, **changes)


def test_a_damaged_policy_is_told_in_a_line(tmp_path):
    kept(tmp_path, point(-5.0, 1.0))
    (path,) = tmp_path.glob("*.safetensors")
    text, tensors = read_container(path, ("mdpo-rddl race 5",))
    tensors["policy 0"] = tensors["policy 0"][:-1]
    write_container(path, tensors, text)
    said = one_line(lambda: RaceProgress(tmp_path, request(tmp_path), NEVER))
    assert "damaged policy file" in said


def test_another_seed_is_another_race(tmp_path):
    kept(tmp_path, point(-5.0, 1.0))
    said = one_line(lambda: RaceProgress(tmp_path, request(tmp_path, seed=4), NEVER))
    assert said.endswith("cannot be resumed: it is of another seed")
