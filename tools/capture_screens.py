"""Captures what the commands show in a terminal, as SVG, and in a pipe, as text.

    python tools/capture_screens.py            # docs/images/screens: 80 columns, light
    python tools/capture_screens.py --all OUT  # 80 and 140 columns, both themes, NO_COLOR, a pipe

Each command runs in a pseudo-terminal, whose last screen is drawn by rich; fonts are the viewer's.
"""

import argparse
import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import tempfile
import termios
from pathlib import Path

import pyte
from rich.console import Console
from rich.style import Style
from rich.terminal_theme import DIMMED_MONOKAI, SVG_EXPORT_THEME, TerminalTheme
from rich.text import Text

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs" / "images" / "screens"
ROWS = 110
WIDTHS = (80, 140)
LIGHT = TerminalTheme(
    (255, 255, 255),
    (40, 40, 40),
    [
        (40, 40, 40),
        (178, 34, 34),
        (0, 110, 60),
        (160, 100, 0),
        (0, 80, 160),
        (140, 40, 140),
        (0, 120, 130),
        (110, 110, 110),
    ],
)
THEMES = {"light": LIGHT, "dark": SVG_EXPORT_THEME or DIMMED_MONOKAI}
FONT_FACE = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)
ROOM = ["examples/room/room.rddl", "examples/room/three.rddl"]
QUICK = ["--preset", "paper", "--iterations", "200", "--episodes", "20", "--out", "OUT/run"]
TINY = ["--problems", "HVAC_ippc2023:1-2", "--planners", "noop,random", "--trials", "3"]

# by the picture's name: the command's module and its arguments; OUT is an empty folder
SCREENS = {
    "plan": ("plan", [*ROOM, *QUICK]),
    "plan-help": ("plan", ["--help"]),
    "plan-race": ("plan", [*ROOM, "--seconds", "20", "--out", "OUT/run"]),
    "plan-list": ("plan", ["--list"]),
    "plan-error": ("plan", ["hvac11"]),
    "report-help": ("report", ["--help"]),
    "ipc-help": ("ipc", ["run", "--help"]),
    "ipc-commands": ("ipc", ["--help"]),
    "ipc-run": ("ipc", ["run", *TINY, "--out", "OUT/ipc"]),
}


def arguments(name: str, folder: str) -> list[str]:
    """What to run for a picture."""
    module, given = SCREENS[name]
    filled = [argument.replace("OUT", folder) for argument in given]
    return [sys.executable, "-W", "ignore", "-m", f"mdpo_rddl.cli.{module}", *filled]


def prompt(name: str) -> str:
    """What the user has written."""
    module, given = SCREENS[name]
    return " ".join([f"$ mdpo-{module}", *(a.replace("OUT", "runs") for a in given)])


def environment(**more: str) -> dict[str, str]:
    """The surroundings of a command: this checkout, and a terminal of the width alone."""
    kept = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "LINES", "NO_COLOR")}
    return {**kept, "TERM": "xterm-256color", "PYTHONPATH": str(ROOT), **more}


def screen(name: str, width: int, **more: str) -> pyte.Screen:
    """The last screen of a command in a terminal."""
    shown = pyte.Screen(width, ROWS)
    stream = pyte.ByteStream(shown)
    with tempfile.TemporaryDirectory() as folder:
        ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, width, 0, 0))
        with subprocess.Popen(
            arguments(name, folder),
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            cwd=ROOT,
            env=environment(**more),
        ):
            os.close(theirs)
            while True:
                try:
                    read = os.read(ours, 65536)
                except OSError:
                    break
                if not read:
                    break
                stream.feed(read.replace(folder.encode(), b"runs"))
        os.close(ours)
    return shown


def as_text(shown: pyte.Screen) -> Text:
    """The screen with its colours, without the empty lines at its end."""
    lines = []
    for row in range(ROWS):
        line = Text()
        for column in range(shown.columns):
            cell = shown.buffer[row][column]
            line.append(cell.data, _style(cell))
        line.rstrip()
        lines.append(line)
    while lines and not lines[-1].plain:
        lines.pop()
    return Text("\n").join(lines)


def _style(cell: pyte.screens.Char) -> Style:
    named = {"brown": "yellow"}
    colour = None if cell.fg == "default" else named.get(cell.fg, cell.fg)
    if colour and re.fullmatch("[0-9a-f]{6}", colour):
        colour = f"#{colour}"
    return Style(color=colour, bold=cell.bold or None, reverse=cell.reverse or None)


def svg(name: str, text: Text, width: int, theme: str) -> str:
    """The picture of a screen."""
    with open(os.devnull, "w") as nowhere:
        console = Console(record=True, width=width, file=nowhere, force_terminal=True)
        console.print(Text(prompt(name), style="bold"))
        console.print(text)
        drawn = console.export_svg(title=name, theme=THEMES[theme], unique_id=name)
    return FONT_FACE.sub("", drawn).replace("Fira Code", "ui-monospace")


def piped(name: str) -> str:
    """What a command writes into a pipe, both of its outputs."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            arguments(name, folder),
            cwd=ROOT,
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        return done.stdout.replace(folder, "runs")


def main() -> None:
    """Captures the screens for the docs, or all of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--all", metavar="OUT", type=Path)
    parser.add_argument("--names", nargs="+", choices=SCREENS)
    options = parser.parse_args()
    out = options.all or DOCS
    out.mkdir(parents=True, exist_ok=True)
    shown = [name for name in SCREENS if options.all or (DOCS / f"{name}.svg").exists()]
    for name in options.names or shown:
        for width in WIDTHS if options.all else WIDTHS[:1]:
            text = as_text(screen(name, width))
            for theme in THEMES if options.all else ("light",):
                file = f"{name}-{width}-{theme}.svg" if options.all else f"{name}.svg"
                (out / file).write_text(svg(name, text, width, theme), encoding="utf-8")
        if options.all:
            plain = as_text(screen(name, WIDTHS[0], NO_COLOR="1"))
            (out / f"{name}-no-color.svg").write_text(svg(name, plain, WIDTHS[0], "light"))
            (out / f"{name}-pipe.txt").write_text(piped(name), encoding="utf-8")
        print(name)


if __name__ == "__main__":
    main()
