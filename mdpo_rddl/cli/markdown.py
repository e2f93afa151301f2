"""How the commands print Markdown."""

import re
import shutil
import sys

_PICTURE = re.compile(r"^!\[.*\]\(.*\)\n+", re.MULTILINE)
_TABLE = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)
_CELLS = re.compile(r"(?<!\\)\|")
# beside a cell, on both sides together
_PADDING = 2


def print_markdown(text: str) -> None:
    """Prints it laid out, without pictures, in a terminal that is wide enough for its tables.

    Elsewhere, as in a pipe, it is printed as it is: no figure is cut off.
    """
    width = shutil.get_terminal_size().columns
    if not sys.stdout.isatty() or table_width(text) > width:
        print(text, end="")
        return
    # takes long to import, which a pipe need not wait for
    from rich.console import Console
    from rich.markdown import Markdown

    Console(width=width).print(Markdown(_PICTURE.sub("", text)))


def table_width(text: str) -> int:
    """Columns of a terminal that the widest table takes; 0 without one."""
    widest = 0
    for table in _TABLE.findall(text):
        rows = [_CELLS.split(line.strip()[1:-1]) for line in table.splitlines()]
        columns = zip(*rows, strict=False)
        widths = [max(len(cell.strip()) for cell in column) + _PADDING for column in columns]
        widest = max(widest, sum(widths))
    return widest
