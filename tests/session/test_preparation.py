"""What an evaluation begins with, done beside training: once, and its mistakes left to it."""

import threading

import pytest
from helpers.problems import shipped

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.session import preparation
from mdpo_rddl.session.preparation import prepare, preparing
from mdpo_rddl.session.requests import PlanRequest


@pytest.fixture(scope="module")
def planner_and_request(tmp_path_factory):
    problem, config = shipped("reservoir15", horizon=3), PRESETS["paper"]("Reservoir")
    request = PlanRequest(problem, config, "paper", 7, 2, tmp_path_factory.mktemp("out"))
    return build_planner(problem, config).planner, request


def test_the_policy_is_compiled_ahead(planner_and_request):
    planner, request = planner_and_request
    assert planner.test_policy._cache_size() == 0
    prepare(planner, request)
    assert planner.test_policy._cache_size() == 1
    prepare(planner, request)
    assert planner.test_policy._cache_size() == 1


def test_it_happens_once_and_has_ended_with_the_block(monkeypatch):
    done = []
    monkeypatch.setattr(preparation, "prepare", lambda *arguments: done.append(arguments))
    with preparing("planner", "request") as begin:
        assert done == []
        begin()
        begin()
    assert done == [("planner", "request")]
    with preparing("planner", "request"):
        pass
    assert len(done) == 1


def test_it_goes_on_beside_the_block(monkeypatch):
    is_begun, may_end, ended = threading.Event(), threading.Event(), []

    def wait(*arguments):
        is_begun.set()
        ended.append(may_end.wait(20.0))

    monkeypatch.setattr(preparation, "prepare", wait)
    with preparing("planner", "request") as begin:
        begin()
        # it has begun, and this goes on all the same
        assert is_begun.wait(20.0)
        assert ended == []
        may_end.set()
    # done in turn, it would have waited for what comes after it
    assert ended == [True]


def test_its_mistakes_are_left_to_the_evaluation(monkeypatch):
    asked, said = [], []

    def fail(*arguments):
        asked.append(arguments)
        raise RuntimeError("cannot be compiled")

    monkeypatch.setattr(preparation, "prepare", fail)
    monkeypatch.setattr(threading, "excepthook", said.append)
    with preparing("planner", "request") as begin:
        begin()
    assert len(asked) == 1
    assert said == []
