"""`mdpo-ipc agent` with planners whose messages are garbled, repeated, cut or late."""

import pytest
from helpers.toy_contest import tiny_instance

from mdpo_rddl.cli import ipc

LIMITS = ["--plan-seconds", "60", "--trial-seconds", "2", "--memory-gb", "8"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("planner", "status", "second"),
    [
        ("Repeating", 0, ""),
        ("Garbling", 1, " (crash: its process sent no result)"),
        ("CuttingOff", 1, " (timeout: over 2 s)"),
        ("Lagging", 1, " (timeout: over 2 s)"),
    ],
)
def test_a_planner_that_sends_something_else_costs_its_own_entry_only(
    tmp_path, capsys, planner, status, second
):
    problem = tiny_instance(tmp_path / "tiny")
    name = f"helpers.hostile_planners:{planner}"
    words = ["agent", problem.domain, problem.instance, name, "3", *LIMITS]
    assert ipc.main([*words, "--out", str(tmp_path / "out")]) == status
    lines = capsys.readouterr().out.splitlines()
    # whoever has failed plays no more
    count = 2 if second else 3
    assert [line.partition(" with return ")[0] for line in lines] == [
        f"episode {number} ended" for number in range(1, count + 1)
    ]
    assert lines[1].endswith(second)
    honest = [line for line in lines if line is not lines[1] or not second]
    assert not any("(" in line or "99" in line for line in honest)
