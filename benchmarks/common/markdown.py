"""Tables in Markdown."""

from collections.abc import Iterable, Sequence


def table_head(heads: Sequence[str]) -> list[str]:
    """The first two lines of a table."""
    return [table_row(heads), "|" + "---|" * len(heads)]


def table_row(cells: Iterable[object]) -> str:
    """One line of a table."""
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def escaped(text: str) -> str:
    """A text that is shown as it is in a cell of a table."""
    return text.replace("|", "\\|").replace("<", "\\<")


def rounded(value: float, digits: int) -> str:
    """A number with so many digits that count, and no exponent where it is large."""
    return f"{float(f'{value:.{digits}g}'):,.12g}"
