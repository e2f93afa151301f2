"""Inputs that nobody means: real files with something in them changed, and who must bear them.

`tools/fuzz.py` runs many more of them than the tests do.
"""

import contextlib
import io
import random
import shlex
import shutil
import tempfile
import time
import traceback
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from helpers import fuzzing_ipc, fuzzing_runs
from helpers.config_texts import NOISE, TEXT
from helpers.plan_command import DOMAIN, INSTANCE
from mdpo_rddl.cli.option_checks import check_plan_options
from mdpo_rddl.cli.options import plan_parser
from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc.report import (
    DOMAINS_PICTURE,
    JSON,
    MARKDOWN,
    PROFILES_PICTURE,
    write_report,
)
from mdpo_rddl.ipc.results import load_results
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.container import read_container, write_container
from mdpo_rddl.policy.file import FORMAT, SavedPolicy, load_policy, save_policy
from mdpo_rddl.problem.files import ProblemFiles
from mdpo_rddl.problem.load import parse_problem
from mdpo_rddl.problem.source import ProblemSource

MOST_SECONDS = 10.0
REPORT_FILES = (MARKDOWN, JSON, DOMAINS_PICTURE, PROFILES_PICTURE)
WORDS = [
    "",
    "0",
    "-1",
    "1e999",
    "nan",
    "-inf",
    "9" * 5000,
    "null",
    "true",
    "{}",
    "[]",
    "[" * 3000,
    "(" * 3000,
    '"',
    "'",
    "\x00",
    "\ufeff",
    "\u202e",
    "\ud7ff\U0010ffff",
    "../" * 8 + "etc/passwd",
    "/dev/zero",
    "__import__('os').system('true')",
    "%(key)s",
    "\n[Planner]\n",
    "forall_{?t : tank}",
    "'",
    ";",
    "}",
    "{",
    "?t",
    "KronDelta(",
    "// ",
]
COMMAND = (
    "tanks.rddl two.rddl --preset paper --noise adaptive --sigma-max 3 --alpha 0.5 --seed 3 "
    "--iterations 30 --seconds 5 --horizon 7 --out run --json --quiet --checkpoint-seconds 2"
)


def mutated(text: str, chance: random.Random) -> str:
    """The text with one to four things in it changed."""
    for _ in range(chance.randint(1, 4)):
        start = chance.randrange(len(text) + 1)
        end = min(len(text), start + chance.choice([0, 1, 1, 3, 20, 200]))
        change = chance.randrange(6)
        if change == 0:
            text = text[:start] + text[end:]
        elif change == 1:
            text = text[:end] + text[start:]
        elif change == 2:
            text = text[:start] + chance.choice(WORDS) + text[end:]
        elif change == 3:
            words = text.split(" ")
            words[chance.randrange(len(words))] = chance.choice([*WORDS, *words])
            text = " ".join(words)
        elif change == 4:
            text = text[:start] + chr(chance.randrange(1, 0xD800)) + text[end:]
        else:
            text = text[:start] if chance.random() < 0.2 else text[:start] + text[start:] * 2
        text = text[:100_000]
    return text


def mutated_bytes(data: bytes, chance: random.Random) -> bytes:
    """As `mutated`, byte by byte."""
    return mutated(data.decode("latin-1"), chance).encode("utf-8", "replace")


class Fuzzer:
    """Feeds changed inputs to whoever reads them.

    Attributes:
      outcomes: per kind of input, how many were refused and how many accepted.
      failures: what happened otherwise.
    """

    def __init__(self, folder: Path, seed: int = 0) -> None:
        self.folder = folder
        self.chance = random.Random(seed)
        self.outcomes: dict[str, list[int]] = {}
        self.failures: list[str] = []
        self.kinds: dict[str, Callable[[], object]] = {
            "configuration": self.configuration,
            "command line": self.command_line,
            "policy file": self.policy_file,
            "policy contents": self.policy_contents,
            "run of mdpo-ipc": self.results,
            "RDDL": self.rddl,
            "run folder": self.run_folder,
        }

    def run(self, kind: str) -> None:
        """One input of a kind."""
        counts = self.outcomes.setdefault(kind, [0, 0])
        started = time.monotonic()
        try:
            self.kinds[kind]()
            counts[1] += 1
        except InputError as error:
            counts[0] += 1
            if not str(error).strip():
                self.failures.append(f"{kind}: an empty message")
        except Exception:
            self.failures.append(f"{kind}: {traceback.format_exc()}")
        if time.monotonic() - started > MOST_SECONDS:
            self.failures.append(f"{kind}: {time.monotonic() - started:.1f} s")

    def configuration(self) -> object:
        """A `.cfg` file."""
        return PlannerConfig.from_text(mutated(TEXT + NOISE, self.chance), "a.cfg")

    def command_line(self) -> object:
        """The words of a command; the exit status of a refused one is 2."""
        try:
            words = shlex.split(mutated(COMMAND, self.chance))
        except ValueError as error:
            raise InputError(str(error)) from error
        try:
            with contextlib.redirect_stderr(io.StringIO()):
                check_plan_options(plan_parser().parse_args(words))
        except SystemExit as end:
            if end.code != 2:
                raise RuntimeError(f"exit status {end.code}") from end
            raise InputError("refused") from end
        return words

    def policy_file(self) -> object:
        """The bytes of a policy file."""
        path = self.folder / "a.safetensors"
        path.write_bytes(mutated_bytes(policy_bytes(), self.chance))
        return load_policy(path, self.folder)

    def policy_contents(self) -> object:
        """A policy file that is whole, with something else in it."""
        path = self.folder / "b.safetensors"
        path.write_bytes(policy_bytes())
        text, tensors = read_container(path, (FORMAT,))
        name = self.chance.choice(sorted(text))
        text[name] = mutated(text[name], self.chance).replace("\x00", "")
        if self.chance.random() < 0.3:
            key = self.chance.choice(sorted(tensors))
            tensors[mutated(key, self.chance).replace("\x00", "")] = tensors.pop(key)
        write_container(path, tensors, text)
        return load_policy(path, self.folder)

    def results(self) -> object:
        """A folder of `mdpo-ipc`."""
        root = self.folder / "ipc"
        shutil.rmtree(root, ignore_errors=True)
        fuzzing_ipc.write_run(root)
        fuzzing_ipc.change_one(root, self.chance, mutated)
        before = {each for each in root.rglob("*") if each.is_file()}
        try:
            for result in load_results(root):
                result.save(root)
            write_report(root)
        finally:
            written = {each for each in root.rglob("*") if each.is_file()} - before
            if written - {root / name for name in REPORT_FILES}:
                raise RuntimeError(f"written elsewhere: {written}")
        return root

    def rddl(self) -> object:
        """A domain or an instance."""
        texts = [DOMAIN, INSTANCE]
        which = self.chance.randrange(2)
        texts[which] = mutated(texts[which], self.chance)
        files = ProblemFiles(Path("a.rddl"), Path("b.rddl"), *texts, "fuzz", is_own=True)
        return parse_problem(files, tables=self.folder / "tables")

    def run_folder(self) -> object:
        """A run folder, of which the report is written."""
        return fuzzing_runs.read(self.folder / "report", self.chance, mutated)


@cache
def policy_bytes() -> bytes:
    """A policy file as `mdpo-plan` writes it."""
    source = ProblemSource("tanks.rddl", "two.rddl", DOMAIN, INSTANCE, "two", 7)
    policy = SavedPolicy(
        params={"params": {"Dense_0": {"kernel": np.ones((2, 3), np.float32)}}},
        policy_hyperparams={"fill": np.array(1.0, np.float32)},
        config=TEXT,
        problem={"domain": "tanks", "horizon": 7, "label": "two", "digest": "0" * 64},
        seed=3,
        source=source,
        candidates=(
            {
                "seconds": 1.0,
                "arm": "training",
                "candidate": "iterate 3",
                "mean_return": -2.0,
                "error": None,
                "became_incumbent": True,
            },
        ),
    )
    with tempfile.TemporaryDirectory() as folder:
        save_policy(Path(folder) / "p", policy)
        return (Path(folder) / "p").read_bytes()
