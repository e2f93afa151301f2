"""The committed tables of the measurements on many tasks are those that their rows give."""

import csv
import re
from pathlib import Path

import pytest

from benchmarks.common.records import Records
from benchmarks.tasks.ablation import ablation_table
from benchmarks.tasks.anytime import anytime_table, read_anytime
from benchmarks.tasks.everywhere import everywhere_table
from benchmarks.tasks.ippc2014 import ippc2014_table
from benchmarks.tasks.published import Task, published, read_published, score
from benchmarks.tasks.published_table import published_table
from benchmarks.tasks.sharing import read_sharing, sharing_table
from benchmarks.tasks.thinking import thinking_table
from benchmarks.tasks.trial import COLUMNS, KEYS, SHORTER, THINKING_COLUMNS

RESULTS = Path(__file__).resolve().parents[2] / "results"


def rows(folder, columns=COLUMNS):
    return Records(folder / "rows.csv", columns, KEYS)


TABLES = {
    "ablation": lambda folder: ablation_table(rows(folder)),
    "ablation_objects": lambda folder: ablation_table(rows(folder)),
    "ablation_goals": lambda folder: ablation_table(rows(folder)),
    "ablation_plans": lambda folder: ablation_table(rows(folder)),
    "ablation_own": lambda folder: ablation_table(rows(folder)),
    "ablation_ppo": lambda folder: ablation_table(rows(folder)),
    "ablation_voting": lambda folder: ablation_table(rows(folder)),
    "ablation_settings": lambda folder: ablation_table(rows(folder)),
    "anytime": lambda folder: anytime_table(read_anytime(folder)),
    "everywhere": lambda folder: everywhere_table(rows(folder)),
    "everywhere_others": lambda folder: everywhere_table(rows(folder)),
    "ippc2014": lambda folder: ippc2014_table(rows(folder)),
    "published": lambda folder: published_table(read_published(folder / "rows.csv")),
    "published_hundred": lambda folder: published_table(read_published(folder / "rows.csv")),
    "published_thinking": lambda folder: published_table(read_published(folder / "rows.csv")),
    "published_second": lambda folder: published_table(read_published(folder / "rows.csv")),
    "published_undecided": lambda folder: published_table(read_published(folder / "rows.csv")),
    "sharing_episode": lambda folder: sharing_table(read_sharing(folder)),
    "sharing_same": lambda folder: sharing_table(read_sharing(folder)),
    "sharing": lambda folder: sharing_table(read_sharing(folder)),
    "thinking_hidden": lambda folder: thinking_table(rows(folder, THINKING_COLUMNS)),
    "thinking_ipc2023": lambda folder: thinking_table(rows(folder, THINKING_COLUMNS)),
    "thinking_voting": lambda folder: thinking_table(rows(folder, THINKING_COLUMNS)),
    "thinking_settings": lambda folder: thinking_table(rows(folder, THINKING_COLUMNS)),
    "thinking_uav": lambda folder: thinking_table(rows(folder, THINKING_COLUMNS)),
}


def test_as_many_proven_optima_are_below_the_published_best_as_the_pages_say():
    tasks = published()
    scores = [
        score(float(row["mean"]), tasks[Task(row["problem"], row["instance"])])
        for row in rows(RESULTS / "published_hundred").rows
        if row["arms"] == "dynamic programming"
    ]
    below = sum(each < 0.99 for each in scores)
    for page, said in (
        ("results.md", f"is proven on {len(scores)}, and {below} of these are below 0.99"),
        ("thinking.md", f"on {below} of the {len(scores)} proven optima"),
    ):
        text = (RESULTS.parent / "docs" / page).read_text(encoding="utf-8")
        assert said in " ".join(text.split())


def test_as_many_tasks_are_at_the_best_published_with_a_second_as_the_page_says():
    tasks = published()
    scores = {}
    for name in ("published_thinking", "published_second"):
        for row in rows(RESULTS / name, (*THINKING_COLUMNS, SHORTER)).rows:
            task = Task(row["problem"], row["instance"])
            scores[task] = score(float(row["mean"]), tasks[task])
    count = sum(each >= 0.99 for each in scores.values())
    page = (RESULTS.parent / "docs" / "thinking.md").read_text(encoding="utf-8")
    assert f"with these ours is at 0.99 on {count}" in " ".join(page.split())


@pytest.mark.parametrize("name", ["sharing", "sharing_episode", "sharing_same"])
def test_how_often_thinking_is_better_is_what_the_page_says(name):
    page = (RESULTS.parent / "docs" / "thinking.md").read_text(encoding="utf-8")
    beside = next(line for line in page.splitlines() if f"results/{name}/table.md" in line)
    counts = re.findall(r"(better|as good|worse) on (\d+)", beside)
    told = ", ".join(f"{word} on {count}" for word, count in counts)
    assert sharing_table(read_sharing(RESULTS / name)).endswith(f": {told}.\n")


def test_the_no_op_returns_what_was_published_on_as_many_tasks_as_the_page_says():
    with (RESULTS / "published_noop" / "rows.csv").open(encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    tasks = published()
    assert {Task(row["problem"], row["instance"]) for row in found} == set(tasks)
    known = [row for row in found if float(row["std"]) > 1e-5 * abs(float(row["ours"]))]
    other = [row for row in found if not is_as_published(row)]
    assert {row["problem"] for row in other} == {"Tamarisk_MDP_ippc2014"}
    assert all(row in known for row in other)
    page = (RESULTS.parent / "docs" / "results.md").read_text(encoding="utf-8")
    same = len(known) - len(other)
    assert f"on {same} of the {len(known)} tasks on which its returns vary" in " ".join(
        page.split()
    )


def is_as_published(row):
    """To the six digits that were published."""
    return float(row["ours"]) == pytest.approx(float(row["published"]), rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_that_of_its_rows(name):
    folder = RESULTS / name
    assert (folder / "table.md").read_text(encoding="utf-8") == TABLES[name](folder)
