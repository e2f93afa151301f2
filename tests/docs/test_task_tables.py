"""The committed tables of the measurements on many tasks are those that their rows give."""

from pathlib import Path

import pytest

from mdpo_rddl.bench.common.records import Records
from mdpo_rddl.bench.tasks.ablation import ablation_table
from mdpo_rddl.bench.tasks.anytime import anytime_table, read_anytime
from mdpo_rddl.bench.tasks.everywhere import everywhere_table
from mdpo_rddl.bench.tasks.published import published_table, read_published
from mdpo_rddl.bench.tasks.sharing import read_sharing, sharing_table
from mdpo_rddl.bench.tasks.thinking import thinking_table
from mdpo_rddl.bench.tasks.trial import COLUMNS, KEYS, THINKING_COLUMNS

RESULTS = Path(__file__).resolve().parents[2] / "results"


def rows(folder, columns=COLUMNS):
    return Records(folder / "rows.csv", columns, KEYS)


TABLES = {
    "ablation": lambda folder: ablation_table(rows(folder)),
    "ablation_own": lambda folder: ablation_table(rows(folder)),
    "ablation_settings": lambda folder: ablation_table(rows(folder)),
    "anytime": lambda folder: anytime_table(read_anytime(folder)),
    "everywhere": lambda folder: everywhere_table(rows(folder)),
    "published": lambda folder: published_table(read_published(folder / "rows.csv")),
    "published_hundred": lambda folder: published_table(read_published(folder / "rows.csv")),
    "published_thinking": lambda folder: published_table(read_published(folder / "rows.csv")),
    "published_undecided": lambda folder: published_table(read_published(folder / "rows.csv")),
    "sharing": lambda folder: sharing_table(read_sharing(folder)),
    "thinking_hidden": lambda folder: thinking_table(rows(folder, THINKING_COLUMNS)),
    "thinking_ipc2023": lambda folder: thinking_table(rows(folder, THINKING_COLUMNS)),
    "thinking_settings": lambda folder: thinking_table(rows(folder, THINKING_COLUMNS)),
    "thinking_uav": lambda folder: thinking_table(rows(folder, THINKING_COLUMNS)),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_that_of_its_rows(name):
    folder = RESULTS / name
    assert (folder / "table.md").read_text(encoding="utf-8") == TABLES[name](folder)
