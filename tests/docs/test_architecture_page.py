"""The page on the architecture: its drawing and its names are the source's."""

import re
import subprocess
import sys

from helpers.problems import ROOT

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_the_drawing_is_that_of_the_imports():
    command = [sys.executable, str(ROOT / "tools" / "draw_rooms.py"), "--check"]
    done = subprocess.run(command, check=False)
    assert done.returncode == 0, "run: python tools/draw_rooms.py"


def test_every_file_that_the_page_names_is_there():
    named = set(re.findall(r"`((?:\w+/)+\w+\.py)`", PAGE))
    assert len(named) > 15
    missing = [n for n in named if not any((r / n).is_file() for r in (ROOT, ROOT / "mdpo_rddl"))]
    assert missing == []
