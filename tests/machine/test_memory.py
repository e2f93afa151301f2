"""The memory of a process is bounded while it works."""

import os
import threading

import numpy as np

from mdpo_rddl.machine.memory import watched_memory
from mdpo_rddl.machine.process_tree import members, resident_bytes


def test_what_exceeds_the_limit_is_told_once():
    told, happened = [], threading.Event()

    def exceeded(resident: float) -> None:
        told.append(resident)
        happened.set()

    # children of earlier tests count too
    limit = resident_bytes(members(os.getpid())) + 2e8
    with watched_memory(limit, exceeded):
        assert not happened.wait(0.3)
        held = np.ones(6 * 10**7)  # 480 MB
        assert happened.wait(20.0)
        assert held[-1] == 1.0
    assert len(told) == 1
    assert told[0] > limit


def test_nothing_is_watched_after_the_block():
    before = threading.active_count()
    with watched_memory(1e18, lambda resident: None):
        assert threading.active_count() == before + 1
    assert threading.active_count() == before
