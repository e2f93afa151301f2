"""Every table of measurements in the README and the docs says what `results/` says."""

import csv
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from helpers.problems import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
NUMBER = re.compile(r"-?\d[\d,]*(\.\d+)?")
# what stands around a figure: emphasis, a factor's sign, seconds
DRESS = re.compile(r"^(x )|( s)$|\*")


class Table(NamedTuple):
    """A table in a page, and the folder under results/ that was linked last before it."""

    page: str
    line: int
    source: str
    header: list[str]
    rows: list[list[str]]


class Fact(NamedTuple):
    """A figure in a file of results, and the words that say whose it is."""

    words: frozenset[str]
    value: float


def cells(row: str) -> list[str]:
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", row.strip()[1:-1])]


def figures(cell: str) -> list[str]:
    """The numbers of a cell that holds nothing else; a mean and its deviation are two."""
    bare = re.sub(r" ?\\?\*", "", cell)
    parts = [DRESS.sub("", part.strip()) for part in re.split(r"[;±]", bare)]
    return parts if all(NUMBER.fullmatch(part) for part in parts) else []


def words(text: str) -> frozenset[str]:
    found = re.split(r"[\W_]+", text.lower())
    return frozenset(word for word in found if not word.isdigit()) - {"", "the", "s"}


def tables(page: Path) -> Iterator[Table]:
    source, block = "", []
    for number, line in enumerate([*page.read_text(encoding="utf-8").splitlines(), ""], 1):
        if line.startswith("|"):
            block.append(line)
            continue
        if block:
            header, _, *rows = map(cells, block)
            yield Table(page.name, number - len(block), source, header, rows)
            block = []
        for found in re.findall(r"\bresults/(\w+)", line):
            source = found


def is_measured(table: Table) -> bool:
    """Whether at least two of its rows hold two figures each; defaults of options are none."""
    full = [row for row in table.rows if sum(bool(figures(cell)) for cell in row) > 1]
    return len(full) > 1 and table.header[0] != "option"


MEASURED = [table for page in PAGES for table in tables(page) if is_measured(table)]


def facts(folder: Path) -> Iterator[Fact]:
    for path in folder.rglob("*.csv"):
        with path.open(newline="") as file:
            for row in csv.DictReader(file):
                yield from facts_of_record(row)
    for path in folder.rglob("*.json"):
        yield from leaves(json.loads(path.read_text()), frozenset())
    for path in folder.rglob("*.md"):
        for table in tables(path):
            for row in table.rows:
                for name, cell in zip(table.header, row, strict=True):
                    for figure in figures(cell):
                        yield Fact(words(row[0]) | words(name), as_float(figure))


def facts_of_record(row: dict[str, str]) -> Iterator[Fact]:
    named = frozenset().union(*(words(v) for v in row.values() if not is_number(v)))
    for name, value in row.items():
        if is_number(value):
            yield Fact(named | words(name), float(value))


def leaves(tree: object, named: frozenset[str]) -> Iterator[Fact]:
    if isinstance(tree, dict):
        beside = frozenset().union(*(words(v) for v in tree.values() if isinstance(v, str)))
        for key, value in tree.items():
            yield from leaves(value, named | beside | words(key))
    elif isinstance(tree, list):
        for value in tree:
            yield from leaves(value, named)
    elif isinstance(tree, int | float):
        yield Fact(named, float(tree))


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def as_float(figure: str) -> float:
    return float(figure.replace(",", ""))


def disagreements(table: Table) -> list[str]:
    """Its figures that are in no row of the same words in the results."""
    folder = ROOT / "results" / table.source
    written = {
        tuple(row) for path in folder.rglob("*.md") for other in tables(path) for row in other.rows
    }
    known = list(facts(folder))
    vocabulary = frozenset().union(*(fact.words for fact in known))
    wrong = []
    for row in table.rows:
        if tuple(row) in written:
            continue
        for name, cell in zip(table.header[1:], row[1:], strict=True):
            asked = vocabulary & (words(row[0]) | words(name))
            for figure in figures(cell):
                decimals = len(figure.partition(".")[2])
                if not any(
                    asked <= fact.words
                    and abs(fact.value - as_float(figure)) <= 0.5 * 10**-decimals + 1e-9
                    for fact in known
                ):
                    wrong.append(f"{row[0]}, {name}: {figure}")
    return wrong


def test_the_tables_are_found():
    assert len(MEASURED) >= 10
    assert all((ROOT / "results" / table.source).is_dir() for table in MEASURED)
    assert {"results.md", "speed.md", "configuration.md", "README.md"} <= {t.page for t in MEASURED}


@pytest.mark.parametrize("table", MEASURED, ids=lambda table: f"{table.page}:{table.line}")
def test_a_table_says_what_the_results_say(table):
    assert disagreements(table) == []


@pytest.mark.parametrize("table", MEASURED, ids=lambda table: f"{table.page}:{table.line}")
def test_a_changed_figure_would_be_seen(table):
    row = max(table.rows, key=lambda row: sum(bool(figures(cell)) for cell in row))
    place = max(range(1, len(row)), key=lambda i: len(row[i]) if figures(row[i]) else 0)
    (figure, *_) = figures(row[place])
    changed = [*row]
    changed[place] = changed[place].replace(figure, figure[:-1] + str((int(figure[-1]) + 5) % 10))
    rows = [changed if other is row else other for other in table.rows]
    assert disagreements(table._replace(rows=rows)) != []


def totals(folder: str) -> tuple[str, float]:
    """The number of tasks at 0.99 or above, and the mean score, as a folder's table says them."""
    text = (ROOT / "results" / folder / "table.md").read_text(encoding="utf-8")
    said = r"or above: (\d+) of 81\. Mean score, each at most 1: ([\d.]+)\. "
    best, mean = re.findall(said, text)[0]
    return best, float(mean)


def test_the_published_tasks_with_and_without_time_to_think_are_those_of_the_pages():
    said = totals("published"), totals("published_thinking")
    readme, thinking = (
        (ROOT / name).read_text(encoding="utf-8").replace("\n", " ")
        for name in ("README.md", "docs/thinking.md")
    )
    (best, mean), (more, higher) = said
    assert f"on {best} of 81 public tasks, with a mean score of {mean:.2f}" in readme
    assert f"ours reaches {more} tasks and {higher:.2f}" in readme
    assert f"On {more} of the 81 tasks ours is at 0.99" in thinking
    assert f"with a mean score of {higher:.3f}; that is" in thinking
