"""Child processes: what they answer, how they end, and that none outlives its parent."""

import os
import signal
import subprocess
import sys

import jax
import pytest
from helpers import processes
from helpers.processes import all_gone, is_alive

from mdpo_rddl.machine.child import Child, ChildEndedError, _signal_name
from mdpo_rddl.machine.process_tree import members, resident_bytes, shared_out_bytes


def test_it_answers_in_turn_from_a_process_of_its_own():
    with Child(processes.echo) as child:
        child.ask({"a": [1.5, None]})
        child.ask("b")
        assert child.answer(60.0) == [{"a": [1.5, None]}, child.pid]
        assert child.answer(60.0) == ["b", child.pid]
        assert child.pid != os.getpid()
        with pytest.raises(TimeoutError):
            child.answer(0.2)
        # signals for all processes of a job are for the parent to answer
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR2):
            os.kill(child.pid, number)
        child.ask("c")
        assert child.answer(60.0) == ["c", child.pid]
        folder = child.folder
        assert folder.is_dir()
    assert not is_alive(child.pid)
    assert not folder.exists()


def test_its_last_words_are_told():
    with Child(processes.leaves_by_itself) as child:
        holder = child.answer(60.0)
        with pytest.raises(ChildEndedError, match=r"^exit status 3: no such kernel$"):
            child.answer(60.0)
        assert is_alive(holder)
    assert all_gone([holder], 10.0)


def test_a_killed_one_is_told():
    with Child(processes.echo) as child:
        os.kill(child.pid, signal.SIGKILL)
        with pytest.raises(ChildEndedError, match=r"^killed by SIGKILL"):
            child.answer(60.0)
        with pytest.raises(ChildEndedError, match=r"^killed by SIGKILL"):
            child.ask("anybody there?")


def test_everything_that_it_has_started_ends_with_the_block():
    with Child(processes.parent_of_two) as child:
        started = child.answer(60.0)
        everyone = {child.pid, *started}
        assert members(child.pid) == everyone
        assert resident_bytes(everyone) > resident_bytes([child.pid]) > 10**6
        assert shared_out_bytes(everyone) <= resident_bytes(everyone)
        child.end()
        assert all_gone(everyone, 10.0)


def test_an_orphan_in_a_session_of_its_own_ends_with_the_block():
    with Child(processes.parent_of_an_orphan) as child:
        orphan = set(child.answer(60.0))
        assert orphan <= members(child.pid)
        child.end()
        assert all_gone(orphan, 10.0)


PARENT = """
import time
from helpers import processes
from mdpo_rddl.machine.child import Child

child = Child(processes.{what})
print(child.pid, *child.answer(), flush=True)
time.sleep(600)
"""


@pytest.mark.parametrize(("what", "count"), [("parent_of_two", 3), ("parent_of_an_orphan", 2)])
def test_none_outlives_a_parent_that_is_killed(what, count):
    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    with subprocess.Popen(
        [sys.executable, "-c", PARENT.format(what=what)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": paths},
    ) as parent:
        everyone = [int(number) for number in parent.stdout.readline().split()]
        assert len(everyone) == count
        assert all(map(is_alive, everyone))
        parent.kill()
    assert all_gone(everyone, 30.0)


@pytest.mark.parametrize("keeps", [True, False])
def test_it_keeps_compiled_programs_if_its_parent_does(keeps, tmp_path, monkeypatch):
    kept, forbidden = tmp_path / "kept", tmp_path / "forbidden"
    # what the variable says is not what this process does
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(forbidden))
    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(kept) if keeps else None)
    try:
        with Child(processes.compiles, on_cpu=True) as child:
            assert child.answer(120.0) == 4.0
    finally:
        jax.config.update("jax_compilation_cache_dir", before)
    assert any(kept.iterdir()) if keeps else not kept.exists()
    assert not forbidden.exists()


def test_a_signal_without_a_name_has_its_number():
    assert _signal_name(9) == "SIGKILL"
    assert _signal_name(40) == "signal 40"
