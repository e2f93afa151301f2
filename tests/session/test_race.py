"""A race as a session asks for it: what it hears, what it is given, and what is said of the end."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.tanks import DOMAIN, INSTANCE
from helpers.toys import problem_from

from mdpo_rddl.errors import Cancelled
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.problem.evaluation import Evaluation
from mdpo_rddl.race.arm import Candidate
from mdpo_rddl.race.race import GIVEN
from mdpo_rddl.session.race import RaceHooks, find_by_race, less_than_promised
from mdpo_rddl.session.requests import PlanRequest
from mdpo_rddl.session.watch import Watch

PROBLEM = problem_from(DOMAIN + INSTANCE, horizon=4)


class Heard:
    """Keeps what it is told."""

    def __init__(self):
        self.stages, self.incumbents, self.fractions = [], [], []

    def stage(self, name):
        self.stages.append(name)

    def incumbent(self, found):
        self.incumbents.append(found)

    def racing(self, fraction):
        self.fractions.append(fraction)


def request(seconds=0.5, problem=PROBLEM, **more):
    config = PRESETS["auto"]("tanks").with_values("Optimize", train_seconds=seconds)
    return PlanRequest(problem, config, "auto", 3, 2, None, **more)


@pytest.fixture(scope="module")
def found():
    heard = Heard()
    return find_by_race(request(), heard), heard


def test_who_listens_hears_the_incumbents_and_how_the_time_goes(found):
    result, heard = found
    assert heard.stages == ["probing", "searching", "confirming"]
    means = [each.mean for each in heard.incumbents]
    assert means == [
        each["mean_return"] for each in result.diagnostics["candidates"] if each["became_incumbent"]
    ]
    assert heard.fractions == sorted(heard.fractions)
    assert heard.fractions[-1] <= 1.0
    assert not result.interrupted
    # a leaking tank is worth filling
    assert result.policy.returns[-1] > result.diagnostics["noop_return"]


def test_it_goes_on_from_what_an_earlier_process_has_found(found):
    result, _ = found
    earlier = result.diagnostics["candidates"]
    candidate = Candidate("plans", "from before", result.policy)
    hooks = RaceHooks((candidate,), earlier, used=1e6)
    again = find_by_race(request(), Heard(), hooks)
    assert again.diagnostics["candidates"][: len(earlier)] == list(earlier)
    assert again.diagnostics["candidates"][len(earlier)]["candidate"] == "from before"
    # hardly any time was left
    assert again.seconds == pytest.approx(1e6, abs=60.0)


def test_it_begins_with_a_policy_that_it_is_given(found):
    result, _ = found
    again = find_by_race(request(start_from=result.policy), Heard())
    assert GIVEN in [each["arm"] for each in again.diagnostics["candidates"]]


def test_a_policy_of_another_domain_is_refused(found):
    other = problem_from((DOMAIN + INSTANCE).replace("tanks", "others"), horizon=4)
    start = found[0].policy
    said = one_line(lambda: find_by_race(request(problem=other, start_from=start), Heard()))
    assert said == "cannot start from a policy of the domain 'tanks': it is not 'others'"


def test_a_race_that_is_stopped_before_it_knows_anything_keeps_the_no_op(monkeypatch):
    def stopped(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr("mdpo_rddl.race.race.race", stopped)
    result = find_by_race(request(), Heard())
    assert result.interrupted
    assert result.diagnostics["candidates"] == []
    action = result.policy(0, {"volume": np.array([5.0, 5.0])})
    np.testing.assert_array_equal(action["fill"], 0.0)


def test_a_watch_that_is_cancelled_ends_it_with_what_was_found():
    cancel = threading.Event()
    watch = Watch(60.0, Heard(), cancel=cancel)
    hooks = RaceHooks(on_judged=lambda point: cancel.set())
    result = find_by_race(request(60.0), watch, hooks)
    assert result.interrupted
    assert result.seconds < 30.0
    with pytest.raises(Cancelled):
        watch.racing(0.5)


def test_less_than_promised_is_beyond_the_errors():
    def said(promised, returns):
        lengths = np.full(len(returns), 4)
        played = Evaluation(np.array(returns), lengths, illegal_actions=0, fallback_actions=0)
        return less_than_promised(SimpleNamespace(promised=promised), played)

    assert said((10.0, 0.1), [5.0, 5.1]).startswith(
        "the exact environment paid 5.05 where the race's own episodes had 10"
    )
    assert said((10.0, 0.1), [9.5, 10.4]) == ""
    assert said((10.0, 2.0), [5.0, 5.1]) == ""
    assert said(None, [5.0, 5.1]) == said((10.0, 0.1), [5.0]) == ""
