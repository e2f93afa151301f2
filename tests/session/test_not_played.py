"""An environment that fails while a policy is played costs the evaluation, not the policy."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.files import changed
from helpers.mistakes import one_line
from helpers.plan_command import TANKS, run
from helpers.tanks import DOMAIN, INSTANCE
from helpers.toys import problem_from

from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.played import NotPlayedError, PlayedSimulator
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.observed import Observed
from mdpo_rddl.session.report.page.record import read_play, read_run
from mdpo_rddl.session.requests import Terms

# numpy draws from no Poisson distribution with a mean over 9.2e18
FAILING = " + min[0.0, Poisson(volume(?t) * 1800000000000000000.0)]"


class Silent:
    def stage(self, name):
        """Nobody listens."""

    def episode(self, done, of):
        """Nobody listens."""


def failing_problem():
    text = changed(DOMAIN, " - Uniform(0.0, 1.0)", f" - Uniform(0.0, 1.0){FAILING}")
    return problem_from(text + INSTANCE, horizon=4)


def fill(step, state):
    return {"fill": np.full(2, 1.0)}


def test_the_environments_error_names_the_files_and_the_episode():
    problem = failing_problem()
    evaluator = Evaluator(Terms(problem, seed=5, episodes=3), Silent())
    assert one_line(lambda: evaluator.run(fill)) == (
        f"{problem.domain_path}, {problem.instance_path}: episode 1: the environment fails: "
        "ValueError: lam value too large"
    )


def test_the_policys_error_is_its_own():
    evaluator = Evaluator(Terms(failing_problem(), seed=5, episodes=3), Silent())
    with pytest.raises(ZeroDivisionError):
        evaluator.run(lambda step, state: {"fill": 1 // step})


def test_the_returns_are_those_of_the_plain_simulator():
    problem = problem_from(DOMAIN + INSTANCE, horizon=4)
    env = make_environment(problem, backend=PlayedSimulator)
    found = evaluate(env, fill, 3, 5).returns
    np.testing.assert_array_equal(found, evaluate(make_environment(problem), fill, 3, 5).returns)


def test_a_reference_that_the_environment_refuses_is_left_out(tmp_path, monkeypatch):
    terms = Terms(problem_from(DOMAIN + INSTANCE, horizon=4), seed=5, episodes=3)
    observed = Observed(terms)
    found = Evaluator(terms, Silent()).run(fill, observed)

    def fail(*given):
        raise NotPlayedError("the environment fails")

    monkeypatch.setattr("mdpo_rddl.session.observed.noop_evaluation", fail)
    references = observed.figures(found.returns)["references"]
    assert references["noop"] is None
    assert references["random"]["simulated"]
    observed.write(tmp_path)
    assert set(read_play(tmp_path / "trajectories.npz")[0]) == {"policy"}


@pytest.mark.long
def test_the_policy_is_saved_and_the_folder_says_why_it_was_not_played(
    workplace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(simulator: PlayedSimulator, actions: object) -> None:
        raise NotPlayedError("the environment fails: ValueError: no")

    monkeypatch.setattr(PlayedSimulator, "step", fail)
    cause = "tanks.rddl, two.rddl: episode 1: the environment fails: ValueError: no"
    outcome = run(f"{TANKS} --iterations 2 --episodes 2 --out run --quiet", capsys)
    assert outcome.status == 2
    told = f"mdpo-plan: error: {cause}; the policy is in run, not played\n"
    assert (outcome.out, outcome.err) == ("", told)
    assert not (workplace / "run.unfinished").exists()
    summary = json.loads((workplace / "run" / "summary.json").read_text())
    assert (summary["not_played"], summary["mean_return"], summary["returns"]) == (cause, None, [])
    assert one_line(lambda: read_run(Path("run"))) == (
        f"run/summary.json: nothing to show, the policy was not played: {cause}"
    )
    # once the environment plays again, so does the policy
    monkeypatch.undo()
    monkeypatch.chdir(workplace)
    loaded = run(f"{TANKS} --load run --episodes 2 --quiet --json", capsys)
    assert len(loaded.summary["returns"]) == 2
