"""The first signal ends a block, whatever becomes of what it raises."""

import contextlib
import json
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.plan_command import TANKS, run
from pyRDDLGym.core.simulator import RDDLSimulator

from mdpo_rddl.cli import termination
from mdpo_rddl.cli.termination import Stop, Terminated, exit_status, stopped_in_two_steps
from mdpo_rddl.errors import InputError, interrupt_behind, note_heard
from mdpo_rddl.problem.played import PlayedSimulator
from mdpo_rddl.session.progress_bar import ProgressBar


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is lost is raised again before a test takes long."""
    monkeypatch.setattr(termination, "_AGAIN_SECONDS", 0.2)
    monkeypatch.setattr(termination, "_LOOK_SECONDS", 0.05)


def swallowed(number: signal.Signals) -> None:
    """As a library's handler of any exception does."""
    with contextlib.suppress(BaseException):
        signal.raise_signal(number)


def turned(number: signal.Signals) -> None:
    """As a library's handler of any exception does that raises one of its own."""
    try:
        signal.raise_signal(number)
    except BaseException:
        raise ArithmeticError("cannot evaluate +")  # noqa: B904


def work_on(seconds: float) -> None:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        time.sleep(0.01)


def stopped(work: Callable[[], None]) -> Stop:
    """What came of the signals in a block of that work."""
    with stopped_in_two_steps("mdpo-plan") as stop:
        work()
    return stop


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize(
    ("number", "kind"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated)]
)
def test_what_is_lost_is_raised_again(number: signal.Signals, kind: type) -> None:
    def work() -> None:
        swallowed(number)
        swallowed(number)  # as GNU timeout sends it
        work_on(30.0)

    with pytest.raises(KeyboardInterrupt) as caught:
        stopped(work)
    assert (type(caught.value), exit_status(caught.value)) == (kind, 128 + number)


@pytest.mark.usefixtures("soon")
def test_it_is_raised_until_it_is_heard() -> None:
    heard = []

    def work() -> None:
        swallowed(signal.SIGINT)
        for number in range(2):
            try:
                work_on(30.0)
            except KeyboardInterrupt as stop:
                heard.append(stop)
                if number == 1:
                    note_heard(stop)
        work_on(0.7)

    assert stopped(work).is_wanted
    assert len(heard) == 2


@pytest.mark.usefixtures("soon")
def test_it_is_not_raised_while_it_ends_the_block() -> None:
    ended = []

    def work() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            work_on(0.7)
            ended.append(True)

    with pytest.raises(KeyboardInterrupt):
        stopped(work)
    assert ended


def test_an_error_that_a_library_has_made_of_it_is_an_interrupt() -> None:
    with pytest.raises(Terminated):
        stopped(lambda: turned(signal.SIGTERM))


def test_an_error_in_the_orderly_end_stays_one() -> None:
    def work() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as stop:
            note_heard(stop)
            raise InputError("the disk is full") from stop

    with pytest.raises(InputError, match="full"):
        stopped(work)


def test_an_interrupt_is_no_failure_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    # pyRDDLGym's simulator makes an error of its own of it
    monkeypatch.setattr(RDDLSimulator, "reset", lambda simulator: turned(signal.SIGINT))
    simulator = object.__new__(PlayedSimulator)
    with pytest.raises(KeyboardInterrupt):
        simulator.reset()


def test_errors_that_are_their_own_cause_end() -> None:
    error = ValueError("round")
    error.__cause__ = error
    assert interrupt_behind(error) is None


@pytest.mark.long
@pytest.mark.usefixtures("soon")
def test_a_run_ends_in_order_though_the_signal_was_lost(
    workplace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lost = []

    def training(bar: ProgressBar, progress: object) -> None:
        if not lost:
            lost.append(progress)
            swallowed(signal.SIGTERM)

    monkeypatch.setattr(ProgressBar, "training", training)
    command = f"{TANKS} --iterations 1000000000 --seconds 60 --out run --quiet --json"
    assert run(command, capsys).status == 143
    assert json.loads((workplace / "run" / "summary.json").read_text())["status"] == "interrupted"
