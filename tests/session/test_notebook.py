"""Progress in a notebook: one display, which is updated."""

import sys
from types import SimpleNamespace

from mdpo_rddl.session.notebook import displayed, is_notebook
from mdpo_rddl.session.watch import PlanProgress


def test_there_is_one_display_and_the_callers_answer_counts(monkeypatch):
    shown = []

    def display(value, display_id):
        shown.append(("new", value))
        return SimpleNamespace(update=lambda value: shown.append(("update", value)))

    fake = SimpleNamespace(HTML=str, display=display)
    monkeypatch.setitem(sys.modules, "IPython.display", fake)
    told = []
    tell = displayed(lambda progress: told.append(progress) or False)
    steps = [PlanProgress("probing", 1.0, 0.25), PlanProgress("searching", 2.0, 0.5, -3.0)]
    assert [tell(step) for step in steps] == [False, False]
    assert told == steps
    assert [kind for kind, _ in shown] == ["new", "update"]
    assert "value='0.250'" in shown[0][1]
    assert "-3.00" in shown[1][1]
    assert displayed(None)(steps[0]) is None


def test_a_test_is_no_notebook():
    assert not is_notebook()
