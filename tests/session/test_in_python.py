"""`mdpo_rddl.plan`: what it takes, gives, tells, and leaves alone."""

import logging
import threading
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from helpers.levers import lever_policy
from helpers.mistakes import one_line
from helpers.problems import tiny_files
from pyRDDLGym import RDDLEnv

import mdpo_rddl
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.policy.lookahead.choice import Choice
from mdpo_rddl.session.configuration import load_preset
from mdpo_rddl.session.training import find_by_training
from mdpo_rddl.session.watch import PlanProgress

CONFIG = """
[Compiler]
print_warnings=False
[Planner]
method='JaxStraightLinePlan'
optimizer='rmsprop'
optimizer_kwargs={'learning_rate': 0.05}
batch_size_train=2
pgpe=None
[Optimize]
epochs=3
[Noise]
method='NoNoise'
"""


@pytest.fixture
def files(tmp_path):
    return tiny_files(tmp_path, horizon=3)


@pytest.fixture
def quick():
    """One short training instead of the race."""
    return partial(mdpo_rddl.plan, config=PlannerConfig.from_text(CONFIG))


def test_a_file_of_a_configuration_and_the_same_bits_again(files, tmp_path, capsys):
    (tmp_path / "slp.cfg").write_text(CONFIG)
    before, handlers = dict(jax.config.values), list(logging.getLogger().handlers)
    planned = partial(mdpo_rddl.plan, *files, config=tmp_path / "slp.cfg", seed=3)
    first, second = planned(), planned()
    assert capsys.readouterr() == ("", "")
    assert dict(jax.config.values) == before
    assert logging.getLogger().handlers == handlers
    for ours, theirs in zip(*(jax.tree.leaves(p.params) for p in (first, second)), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert first.seed == 3
    assert first.config.section("Optimize")["epochs"] == 3
    assert len(first.returns) == 1
    first.save(tmp_path / "saved")
    again = mdpo_rddl.load_policy(tmp_path / "saved")
    mine, other = first.evaluate(episodes=2).returns, again.evaluate(episodes=2).returns
    np.testing.assert_array_equal(mine, other)


def test_an_environment_and_a_problem_in_a_thread(files, quick):
    env = RDDLEnv(*files)
    env.horizon = 2
    found = []
    for given in (env, mdpo_rddl.load_problem(*files, horizon=2)):
        thread = threading.Thread(target=lambda given=given: found.append(quick(given)))
        thread.start()
        thread.join()
    assert [policy.problem.horizon for policy in found] == [2, 2]
    assert found[0].problem.digest == found[1].problem.digest
    result = found[0].evaluate(RDDLEnv(*files), seed=0)
    assert result["mean"] <= 0


def test_a_preset_can_be_changed_and_written(tmp_path):
    config = mdpo_rddl.load_preset().with_values("Search", without=["greedy"])
    assert config.section("Search") == {"without": ["greedy"]}
    (tmp_path / "my.cfg").write_text(config.to_text())
    read = mdpo_rddl.PlannerConfig.from_file(tmp_path / "my.cfg")
    assert read.sections == config.sections
    # the paper's noise is the domain's
    scales = {load_preset("paper", name).section("Noise")["alpha"] for name in ("hvac", "", "tiny")}
    assert scales == {8.0, 1.0}
    with pytest.raises(mdpo_rddl.InputError, match="there is no preset 'best', only auto, paper"):
        load_preset("best")


def test_a_race_is_cancelled_with_what_was_found(files):
    seen: list[PlanProgress] = []

    def until_there_is_a_policy(progress: PlanProgress) -> bool:
        seen.append(progress)
        return progress.best_return is None

    config = load_preset("auto", "tiny")
    policy = mdpo_rddl.plan(*files, seconds=300, config=config, on_progress=until_there_is_a_policy)
    assert "probing" in {progress.stage for progress in seen}
    # beside what was seen, a rule that was kept aside is judged at the end
    found = [one["mean_return"] for one in policy.candidates if one["became_incumbent"]]
    assert pytest.approx(seen[-1].best_return) in found[-2:]
    assert policy.returns[-1] == pytest.approx(found[-1]) == max(found)
    assert "best return" in seen[-1]._repr_html_()
    policy.reset()
    action = policy.sample_action({"x___u1": 0.0, "x___u2": 0.0})
    assert set(action) == {"push___u1", "push___u2"}


def test_a_race_cancelled_from_the_first_has_a_policy_all_the_same(files, monkeypatch):
    cancel = threading.Event()
    cancel.set()
    # nobody waits for the choice of how to think
    monkeypatch.setattr("mdpo_rddl.policy.lookahead.choice.choose", None)
    policy = mdpo_rddl.plan(*files, seconds=300, cancel=cancel, decision_seconds=1.0)
    # nothing was judged yet: the no-op
    assert isinstance(policy, mdpo_rddl.Policy)
    assert policy.evaluate(episodes=1).returns.shape == (1,)


def test_a_training_is_cancelled_after_an_iteration(files, quick):
    config = PlannerConfig.from_text(CONFIG).with_values("Optimize", epochs=10**6)
    cancel = threading.Event()
    cancel.set()
    policy = quick(*files, config=config, cancel=cancel)
    assert policy.candidates[0]["candidate"] == "iterate 0"


def test_an_error_of_the_callback_is_raised_as_it_is(files):
    def fail(progress: PlanProgress) -> None:
        raise ZeroDivisionError(progress.stage)

    with pytest.raises(ZeroDivisionError, match="probing"):
        mdpo_rddl.plan(*files, seconds=300, on_progress=fail)


def test_bad_input_is_told_in_a_line(files, quick):
    problem = mdpo_rddl.load_problem(*files)
    for given, said in (
        (partial(quick, "nowhere.rddl", files[1]), "nowhere.rddl: cannot read the domain file"),
        (partial(quick, *files, seconds=0), "seconds must be a number above 0, got 0"),
        (partial(quick, *files, seed=-1), "seed must be an integer from 0 to 2147483647, got -1"),
        (partial(quick, *files, preset="auto"), "preset and config do not go together"),
        (partial(mdpo_rddl.plan, *files, preset="best"), "there is no preset 'best'"),
        (partial(mdpo_rddl.plan, *files, config="replan"), 'config "replan" plans anew'),
        (
            partial(quick, *files, start_from=SimpleNamespace(to_saved=None)),
            "a policy to start from goes with the preset",
        ),
        (partial(quick, *files, decision_seconds="1"), "decision_seconds must be a number"),
        (partial(quick, *files, on_progress=5), "on_progress must be a function, got 5"),
        (partial(quick, *files, cancel=5), "cancel must be an event of threading's, got 5"),
        (partial(mdpo_rddl.plan, *files, preset=["a"]), "preset must be a name, got ['a']"),
        (partial(mdpo_rddl.plan, *files, config=5), "config must be a file, a name or a Planner"),
        (partial(mdpo_rddl.plan, *files, start_from=5), "start_from must be a policy, got 5"),
        (partial(quick, files[0]), f"{files[0]}: which instance?"),
        (partial(quick, problem, "1"), "an instance does not go with a Problem"),
        (partial(quick, problem, horizon=3), "horizon goes with names or files"),
        (partial(quick, 7), "expected the names or files of a problem"),
        (partial(quick, mdpo_rddl.make_environment(problem)), "the environment was made from a"),
    ):
        assert one_line(given).startswith(said)
    with pytest.raises(TypeError, match="'second'"):
        quick(*files, second=5)


def test_a_greedy_policy_is_not_trained_by_a_gradient():
    problem = lever_policy().problem
    config = PRESETS["paper"](problem.domain_name).with_section("Noise", {"method": "NoNoise"})
    greedy = config.with_values("Planner", method="GreedyPlan", method_kwargs={})
    said = one_line(lambda: mdpo_rddl.plan(problem, config=greedy))
    assert said.endswith("GreedyPlan has no gradient, only the race of the preset auto learns it")


def test_a_file_that_cannot_be_written_is_named(files, quick, tmp_path):
    (tmp_path / "file").write_text("")
    policy = quick(*files)
    path = Path(tmp_path, "file", "policy")
    assert one_line(partial(policy.save, path)).startswith(f"{path}: cannot be written")


def test_time_to_think_is_a_part_of_the_runs_time(files, quick, monkeypatch):
    asked = []

    def choose(policy, seconds, within):
        asked.append((seconds, within))
        return Choice(None, [], "", 0.0)

    monkeypatch.setattr("mdpo_rddl.policy.lookahead.choice.choose", choose)
    assert isinstance(quick(*files), mdpo_rddl.Policy)
    assert asked == []
    # the plain policy is returned where thinking was not chosen
    assert isinstance(quick(*files, seconds=40, decision_seconds=0.5), mdpo_rddl.Policy)
    # a quarter of it is kept for the choice; three iterations leave more
    ((decision, within),) = asked
    assert decision == 0.5
    assert 0.25 * 40.0 < within < 40.0
    for wrong in (-1.0, float("nan")):
        said = one_line(partial(quick, *files, decision_seconds=wrong))
        assert said.startswith("decision_seconds must be a number of at least 0")


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_what_ends_the_choice_loses_no_policy(files, quick, monkeypatch, error):
    def choose(policy, seconds, within):
        raise error

    monkeypatch.setattr("mdpo_rddl.policy.lookahead.choice.choose", choose)
    assert isinstance(quick(*files, seconds=40, decision_seconds=0.5), mdpo_rddl.Policy)


def test_nothing_is_chosen_after_a_stop(files, quick, monkeypatch):
    def interrupted(terms, watch, counts_compilation):
        policy, result = find_by_training(terms, watch, counts_compilation)
        return policy, replace(result, status="interrupted")

    monkeypatch.setattr("mdpo_rddl.session.training.find_by_training", interrupted)
    monkeypatch.setattr("mdpo_rddl.policy.lookahead.choice.choose", None)
    assert isinstance(quick(*files, seconds=40, decision_seconds=0.5), mdpo_rddl.Policy)
