"""The Python in the docs runs, each block in a process of its own in an empty folder."""

import re
import shutil
import subprocess
import sys

import pytest
from helpers.problems import ROOT

TEMPLATE = """
[Compiler]
print_warnings=False
[Planner]
method='JaxStraightLinePlan'
optimizer='rmsprop'
optimizer_kwargs={'learning_rate': 0.05}
batch_size_train=2
rollout_horizon=3
pgpe=None
[Optimize]
epochs=2
print_summary=False
print_progress=False
[Noise]
method='AdaptiveNoise'
sigma_max=SIGMA_TUNE
"""
# what others test: the README's block in test_readme.py, the player's in test_ipc_docs.py
ELSEWHERE = {"ipc.md"}
# the same with fewer trials
SMALLER = {"online=False,": "online=False, eval_trials=1, gp_iters=1,"}


def is_slow(page, code):
    """A tuner's workers are processes; the pages in folders repeat what the others show."""
    return ".tune(" in code or page.parent.name != "docs"


def marks_of(page, code):
    if is_slow(page, code):
        return [pytest.mark.slow, pytest.mark.timeout(300)]
    # each block plans
    return [pytest.mark.long] if page.name == "python.md" else []


BLOCKS = [
    pytest.param(
        code,
        id=f"{page.relative_to(ROOT / 'docs')}:{place}",
        marks=marks_of(page, code),
    )
    for page in sorted((ROOT / "docs").rglob("*.md"))
    if page.name not in ELSEWHERE
    for place, code in enumerate(
        re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    )
]


def test_blocks_are_found():
    assert len(BLOCKS) >= 10


@pytest.mark.parametrize("code", BLOCKS)
def test_a_block_runs(code, tmp_path):
    for path in (ROOT / "examples" / "room").iterdir():
        shutil.copy(path, tmp_path)
    (tmp_path / "template.cfg").write_text(TEMPLATE)
    for old, new in SMALLER.items():
        code = code.replace(old, new)
    (tmp_path / "block.py").write_text(code)
    done = subprocess.run(
        [sys.executable, "block.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
