"""Executors: each task is done once."""

import pytest

from mdpo_rddl.errors import InputError
from mdpo_rddl.executors import make_executor


def test_the_local_executor_does_the_tasks_in_their_order():
    done: list[int] = []
    make_executor("local", {}).run(done.append, [3, 1, 2])
    assert done == [3, 1, 2]


def test_an_error_ends_the_local_executor():
    done: list[int] = []

    def work(task: int) -> None:
        if task == 1:
            raise InputError("no")
        done.append(task)

    with pytest.raises(InputError, match="no"):
        make_executor("local", {}).run(work, [3, 1, 2])
    assert done == [3]


def test_the_executor_must_be_one_that_there_is():
    with pytest.raises(InputError, match="unknown executor 'moon', known are local"):
        make_executor("moon", {})
