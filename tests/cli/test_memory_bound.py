"""`--memory-gb` ends a run that holds more, and what was kept before stays."""

from pathlib import Path

from helpers.files import contents
from helpers.plan_command import OPTIONS, in_a_process, write_problem


def test_a_run_that_holds_more_ends_with_one_line(tmp_path: Path) -> None:
    write_problem(tmp_path)
    kept = tmp_path / "run.unfinished"
    kept.mkdir()
    (kept / "checkpoint-0.safetensors").write_bytes(b"of an earlier process")
    before = contents(tmp_path)
    outcome = in_a_process(f"{OPTIONS} --quiet --out run --resume --memory-gb 0.05", tmp_path)
    assert outcome.status == 2
    (line,) = filter(None, outcome.err.splitlines())
    assert line.startswith("mdpo-plan: error: 0.")
    assert line.endswith(" GB of memory, over --memory-gb 0.05; what was kept before stays")
    assert before.items() <= contents(tmp_path).items()
    assert not (tmp_path / "run").exists()
