"""Changed inputs through the commands themselves, each in a process of its own."""

import random
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from helpers import fuzzing_ipc
from helpers.config_texts import NOISE, TEXT
from helpers.fuzzing import COMMAND, mutated, mutated_bytes, policy_bytes
from helpers.plan_command import DOMAIN, INSTANCE, TANKS

PLAN, IPC = "mdpo_rddl.cli.plan", "mdpo_rddl.cli.ipc"
SHORT = "--horizon 3 --episodes 1 --quiet"
ONCE = f"--preset paper --iterations 1 {SHORT}"
# a command that is refused has to start first, and one that is accepted compiles
MOST_SECONDS = 120.0
STATUSES = (0, 2)


class CommandFuzzer:
    """Starts a command for each changed input.

    Attributes:
      outcomes: per kind of input, how many were refused and how many accepted.
      failures: what happened otherwise.
      longest: seconds of the slowest command.
    """

    def __init__(self, folder: Path, seed: int = 0) -> None:
        self.root = folder
        self.chance = random.Random(seed)
        self.outcomes: dict[str, list[int]] = {}
        self.failures: list[str] = []
        self.longest = 0.0
        self.number = 0
        self.kinds: dict[str, Callable[[Path], Sequence[str]]] = {
            "configuration": self.configuration,
            "command line": self.command_line,
            "policy file": self.policy_file,
            "run of mdpo-ipc": self.results,
            "RDDL": self.rddl,
        }

    def run(self, kind: str) -> None:
        """One input of a kind, in a folder of its own that is the command's current one."""
        self.number += 1
        folder = self.root / str(self.number) / "here"
        folder.mkdir(parents=True)
        (folder / "tanks.rddl").write_text(DOMAIN)
        (folder / "two.rddl").write_text(INSTANCE)
        module, *words = self.kinds[kind](folder)
        started = time.monotonic()
        try:
            done = subprocess.run(
                [sys.executable, "-m", module, *words],
                cwd=folder,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=MOST_SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired:
            self._fail(kind, words, f"longer than {MOST_SECONDS:.0f} s")
            return
        self.longest = max(self.longest, time.monotonic() - started)
        counts = self.outcomes.setdefault(kind, [0, 0])
        counts[done.returncode == 0] += 1
        if done.returncode not in STATUSES or "Traceback" in done.stderr:
            self._fail(kind, words, f"status {done.returncode}: {done.stderr[-2000:]}")
        elif done.returncode == 2 and not done.stderr.strip():
            self._fail(kind, words, "status 2 and nothing said")
        if [path.name for path in folder.parent.iterdir()] != ["here"]:
            self._fail(kind, words, "written outside the folder")

    def _fail(self, kind: str, words: Sequence[str], cause: str) -> None:
        self.failures.append(f"{kind} {self.number}: {shlex.join(words)!r:.500}: {cause}")

    def configuration(self, folder: Path) -> Sequence[str]:
        """A `.cfg` file."""
        text = mutated(TEXT + NOISE, self.chance)
        (folder / "a.cfg").write_text(text, "utf-8", "replace")
        return PLAN, *f"{TANKS} --config a.cfg --iterations 1 {SHORT}".split()

    def command_line(self, folder: Path) -> Sequence[str]:
        """The words of a command, none of which names a place elsewhere."""
        while True:
            try:
                words = shlex.split(mutated(COMMAND, self.chance))
            except ValueError:
                continue
            if not any("/" in word or "\x00" in word for word in words):
                return PLAN, *(word[:100_000] for word in words)

    def policy_file(self, folder: Path) -> Sequence[str]:
        """The bytes of a policy file."""
        (folder / "run").mkdir()
        (folder / "run" / "policy.safetensors").write_bytes(
            mutated_bytes(policy_bytes(), self.chance)
        )
        return PLAN, *f"{TANKS} --load run {SHORT}".split()

    def results(self, folder: Path) -> Sequence[str]:
        """A folder of `mdpo-ipc`."""
        fuzzing_ipc.write_run(folder / "ipc")
        fuzzing_ipc.change_one(folder / "ipc", self.chance, mutated)
        return IPC, "score", "ipc"

    def rddl(self, folder: Path) -> Sequence[str]:
        """A domain or an instance."""
        texts = {"tanks.rddl": DOMAIN, "two.rddl": INSTANCE}
        name = self.chance.choice(sorted(texts))
        text = mutated(texts[name], self.chance)
        (folder / name).write_text(text, "utf-8", "replace")
        return PLAN, *f"{TANKS} {ONCE}".split()
