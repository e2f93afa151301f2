"""Draws the rooms of the package and the imports between them, as they are in the source.

    python tools/draw_rooms.py            # writes docs/images/rooms.svg
    python tools/draw_rooms.py --check    # status 1 if that file is not what it would write

A room is a folder of `mdpo_rddl`; its first line of description is its docstring's. An arrow says
that the upper room imports from the lower one; arrows that others imply are left out.
"""

import argparse
import ast
import sys
from html import escape
from pathlib import Path
from textwrap import wrap

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "mdpo_rddl"
TARGET = ROOT / "docs" / "images" / "rooms.svg"

WIDTH, HEIGHT = 310, 104
GAP_X, GAP_Y = 36, 40
MARGIN = 16
LINE = 15
CHARACTERS = 42


def rooms() -> dict[str, Path]:
    """The rooms' folders by their names."""
    return {path.parent.name: path.parent for path in sorted(PACKAGE.glob("*/__init__.py"))}


def imported(folder: Path) -> set[str]:
    """The rooms that a room imports from."""
    names = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("mdpo_rddl."):
                names.add(str(node.module).split(".")[1])
    return names & rooms().keys() - {folder.name}


def reduced(edges: dict[str, set[str]]) -> dict[str, set[str]]:
    """The edges that no path of others implies."""

    def reach(node: str) -> set[str]:
        return edges[node].union(*(reach(end) for end in edges[node]))

    return {node: ends - set().union(*(reach(end) for end in ends)) for node, ends in edges.items()}


def levels(edges: dict[str, set[str]]) -> list[list[str]]:
    """The rooms by their height over those that import from none, the highest first."""

    def height(node: str) -> int:
        return 1 + max(map(height, edges[node]), default=-1)

    heights = {node: height(node) for node in edges}
    return [
        sorted(node for node in edges if heights[node] == level)
        for level in range(max(heights.values()), -1, -1)
    ]


def description(folder: Path) -> list[str]:
    """The first paragraph of a room's docstring, in lines."""
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))) or ""
    return wrap(" ".join(text.split("\n\n")[0].split()), CHARACTERS)


def inside(folder: Path) -> list[str]:
    """The rooms inside a room, in lines."""
    names = sorted(path.parent.name for path in folder.glob("*/__init__.py"))
    return wrap(" · ".join(names), CHARACTERS)


def drawing() -> str:
    """The picture."""
    folders = rooms()
    edges = {name: imported(folder) for name, folder in folders.items()}
    rows = levels(edges)
    widest = max(map(len, rows))
    width = 2 * MARGIN + widest * WIDTH + (widest - 1) * GAP_X
    height = 2 * MARGIN + len(rows) * HEIGHT + (len(rows) - 1) * GAP_Y
    places = {}
    for number, row in enumerate(rows):
        left = (width - len(row) * WIDTH - (len(row) - 1) * GAP_X) / 2
        for position, name in enumerate(row):
            x = left + position * (WIDTH + GAP_X)
            places[name] = (x, MARGIN + number * (HEIGHT + GAP_Y))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        'font-family="sans-serif" font-size="12">',
        "<title>The rooms of mdpo_rddl and what they import</title>",
        '<defs><marker id="head" markerWidth="8" markerHeight="8" refX="7" refY="4" '
        'orient="auto"><path d="M0,0 L8,4 L0,8 z" fill="#666"/></marker></defs>',
        f'<rect width="{width:g}" height="{height:g}" fill="white"/>',
    ]
    for name, ends in sorted(reduced(edges).items()):
        x, y = places[name]
        for end in sorted(ends):
            to_x, to_y = places[end]
            parts.append(
                f'<line x1="{x + WIDTH / 2:g}" y1="{y + HEIGHT:g}" x2="{to_x + WIDTH / 2:g}" '
                f'y2="{to_y:g}" stroke="#666" marker-end="url(#head)"/>'
            )
    for name, (x, y) in places.items():
        parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{WIDTH}" height="{HEIGHT}" rx="6" '
            'fill="#eef4fb" stroke="#1f5f99"/>'
        )
        parts.append(
            f'<text x="{x + 10:g}" y="{y + 19:g}" font-weight="bold" font-size="14">{name}</text>'
        )
        lines = [(line, "#222") for line in description(folders[name])]
        lines += [(line, "#1f5f99") for line in inside(folders[name])]
        for number, (line, color) in enumerate(lines):
            at = y + 19 + LINE * (number + 1)
            parts.append(f'<text x="{x + 10:g}" y="{at:g}" fill="{color}">{escape(line)}</text>')
    return "\n".join([*parts, "</svg>"]) + "\n"


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--check", action="store_true", help="write nothing; status 1 if it differs"
    )
    if parser.parse_args().check:
        return int(not TARGET.is_file() or TARGET.read_text(encoding="utf-8") != drawing())
    TARGET.write_text(drawing(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
