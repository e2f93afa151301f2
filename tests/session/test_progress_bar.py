"""The rows of the progress bar."""

import threading

import pytest

from mdpo_rddl.planner.training.training import Progress
from mdpo_rddl.session import progress_bar
from mdpo_rddl.session.progress_bar import ProgressBar
from mdpo_rddl.session.requests import Incumbent


def progress(iteration: int) -> Progress:
    return Progress(iteration=iteration, fraction=0.5, test_return=1.0, best_return=2.0)


def test_training_has_a_row_of_its_own_whichever_iteration_is_reported_first():
    bar = ProgressBar(shown=False)
    bar.stage("compiling")
    bar.training(progress(49))
    bar.training(progress(99))
    compiling, training = bar._bar.tasks
    assert (compiling.description, training.description) == ("compiling", "training")
    assert compiling.finished
    assert training.fields["note"].startswith("iteration 100 ")


def test_an_incumbent_before_any_stage_is_shown_by_the_first_one():
    # where the environment raises errors nothing is enumerated, and the no-op is there at once
    bar = ProgressBar(shown=False)
    bar.incumbent(Incumbent("constants and rules", -3.0))
    bar.racing(0.25)
    bar.stage("probing")
    assert bar._bar.tasks[0].fields["note"] == "best -3 by constants and rules"


def test_the_bar_of_a_race_moves_with_its_time(monkeypatch):
    times = iter([0.0, 0.01, 1.0])
    monkeypatch.setattr(progress_bar.time, "monotonic", lambda: next(times))
    bar = ProgressBar(shown=False)
    bar.stage("searching")
    completed = []
    for fraction in (0.25, 0.26, 0.5):
        bar.racing(fraction)
        completed.append(bar._bar.tasks[0].completed)
    # not more often than it is looked at
    assert completed == [0.25, 0.25, 0.5]


def test_a_line_says_the_stage_and_its_time(capsys: pytest.CaptureFixture[str]):
    bar = ProgressBar(shown=True)
    assert not bar.say()
    bar.stage("compiling")
    assert bar.say()
    assert capsys.readouterr().err == "mdpo-plan: compiling, 0 s\n"


def test_lines_come_again_and_again_where_there_is_no_terminal(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(progress_bar, "_FIRST_LINE_AFTER", 0.01)
    monkeypatch.setattr(progress_bar, "_SECONDS_OF_A_LINE", 0.01)
    said, stages = [], threading.Semaphore(0)

    def say(bar: ProgressBar) -> bool:
        said.append(bar)
        stages.release()
        return len(said) > 1

    monkeypatch.setattr(ProgressBar, "say", say)
    with ProgressBar(shown=True) as bar:
        for _ in range(3):
            stages.acquire()
    assert set(said) == {bar}
