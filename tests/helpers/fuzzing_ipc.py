"""Folders of `mdpo-ipc` that score, with something in one of their files changed."""

import json
import random
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from mdpo_rddl.ipc.conditions import CONDITIONS, keep_conditions
from mdpo_rddl.ipc.results import EntryResult, Preparation, Trial
from mdpo_rddl.ipc.rules import Entry, Instance, Rules

MEANS = {"mdpo": -2.0, "noop": -3.5}
VALUES: list[Any] = [
    None,
    True,
    "",
    "x",
    "\ud800",
    -1,
    0,
    1.5,
    10**30,
    10**400,
    1e300,
    float("inf"),
    float("nan"),
    [],
    {},
    [[[[[1]]]]],
    {"a": [1]},
]


def write_run(root: Path) -> None:
    """A run that is complete, of two planners."""
    for name, content in _contents().items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(content)


@cache
def _contents() -> dict[str, bytes]:
    """Its files; written once as the package does, which waits for the disk."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "run"
        keep_conditions(root, Rules(trials=2, lenient=True), {"executor": "local", "cores": 2})
        for name, mean in MEANS.items():
            trials = tuple(Trial(i, "ok", "", mean + i, 7, 0, 0.1) for i in range(2))
            entry = Entry(Instance("tanks", "two"), name)
            EntryResult(entry, 2, Preparation("ok", "", 1.0, 30.0), trials).save(root)
        files = [path for path in root.rglob("*") if path.is_file()]
        return {str(path.relative_to(root)): path.read_bytes() for path in files}


def change_one(
    root: Path, chance: random.Random, mutated: Callable[[str, random.Random], str]
) -> None:
    """Changes one value of a file of the run, or its text."""
    paths = [root / CONDITIONS, *sorted(root.glob("entries/*/*/*.json"))]
    path = chance.choice(paths)
    text = path.read_text()
    if chance.random() < 0.3:
        path.write_text(mutated(text, chance), "utf-8", "replace")
        return
    values = json.loads(text)
    places = list(_places(values))
    holder, key = chance.choice(places)
    if chance.random() < 0.1:
        del holder[key]
    else:
        holder[key] = chance.choice(VALUES)
    path.write_text(json.dumps(values))


def _places(values: Any) -> Any:
    """All places of a value in another one, as what holds it and its key there."""
    if not isinstance(values, dict | list):
        return
    for key in values if isinstance(values, dict) else range(len(values)):
        yield values, key
        yield from _places(values[key])
