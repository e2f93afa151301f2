"""Toy domains, each a file of this folder, and how a text becomes a problem."""

import re
import tempfile
from pathlib import Path

from mdpo_rddl.problem.load import Problem, load_problem

FOLDER = Path(__file__).parent


def problem_from(text: str, horizon: int | None = None) -> Problem:
    """The problem of a text that holds a domain and, after it, its non-fluents and instance."""
    domain, instance = re.split(r"^(?=non-fluents\b)", text, flags=re.MULTILINE)
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / "d.rddl", Path(folder) / "i.rddl"]
        for path, part in zip(paths, (domain, instance), strict=True):
            path.write_text(part)
        return load_problem(*map(str, paths), horizon)


def toy(name: str, **exchanged: str) -> Problem:
    """The problem of `name`.rddl in this folder, with words of it, in capitals, exchanged."""
    return problem_from(toy_text(name, **exchanged))


def toy_text(name: str, **exchanged: str) -> str:
    """The text of `toy`."""
    text = (FOLDER / f"{name}.rddl").read_text()
    for word, value in exchanged.items():
        assert len(re.findall(rf"\b{word}\b", text)) == 1, word
        text = re.sub(rf"\b{word}\b", value, text)
    return text
