"""Runs the Dockerfile's steps one by one in clean roots, where there is no container engine.

    sudo python tools/image_steps.py WORK [-- COMMAND ...]

Each stage is a folder in WORK with a Debian of its own (debootstrap, which must be installed, and
chroot); what its base image has beside Debian is Python. The context is the last commit, as a clean
checkout. At the end the entry point runs as the image's user, with the given arguments. Only the
instructions that our Dockerfile has are known; another one ends it.
"""

import argparse
import io
import json
import os
import pwd
import shlex
import shutil
import subprocess
import sys
import tarfile
from dataclasses import dataclass, field
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[1]
SUITE = "bookworm"
PACKAGES = "python3,python3-venv,python-is-python3,ca-certificates"
# of the machine, without which nothing can be fetched there
FROM_HOST = ("etc/resolv.conf", "etc/hosts", "etc/ssl/certs/ca-certificates.crt", "etc/pip.conf")


@dataclass
class Stage:
    """A stage as far as it was built."""

    root: Path
    folder: str = "/"
    user: str = "root"
    environment: dict[str, str] = field(default_factory=dict)
    entry: list[str] = field(default_factory=list)

    def run(self, command: list[str]) -> None:
        """Runs a command in the stage as its user, in its folder."""
        inside = f"cd {shlex.quote(self.folder)} && exec {shlex.join(command)}"
        path = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
        given = {name: value for name, value in os.environ.items() if name.startswith("PIP_")}
        environment = {"PATH": path, "HOME": self.folder, **given, **self.environment}
        chroot = ["chroot", f"--userspec={self.user}", str(self.root), "/bin/sh", "-c", inside]
        subprocess.run(chroot, env=environment, check=True)

    def place(self, path: str) -> Path:
        """Where a path of the stage lies on this machine."""
        return self.root / os.path.normpath(os.path.join(self.folder, path)).lstrip("/")


def instructions(text: str) -> list[tuple[str, str]]:
    """The instructions of a Dockerfile with their arguments, lines joined."""
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    joined = "\n".join(lines).replace("\\\n", " ").splitlines()
    found = [line.strip().partition(" ") for line in joined if line.strip()]
    return [(word, rest.strip()) for word, _, rest in found]


def new_stage(base: Path, work: Path, name: str) -> Stage:
    """A stage with nothing but its base."""
    root = work / name
    shutil.rmtree(root, ignore_errors=True)
    subprocess.run(["cp", "--archive", str(base), str(root)], check=True)
    (root / "dev/null").unlink(missing_ok=True)
    subprocess.run(["mknod", "--mode=666", str(root / "dev/null"), "c", "1", "3"], check=True)
    return Stage(root)


def copied(stage: Stage, stages: dict[str, Stage], context: Path, arguments: str) -> None:
    """What COPY does."""
    words = shlex.split(arguments)
    source = Stage(context)
    if words[0].startswith("--from="):
        source = stages[words.pop(0).removeprefix("--from=")]
    *names, target = words
    goal = stage.place(target)
    for name in names:
        found = source.place(name)
        if found.is_dir():
            shutil.copytree(found, goal, symlinks=True, dirs_exist_ok=True)
        else:
            (goal if target.endswith("/") else goal.parent).mkdir(parents=True, exist_ok=True)
            shutil.copy2(found, goal)


def step(stage: Stage, stages: dict[str, Stage], context: Path, word: str, rest: str) -> None:
    """Carries out one instruction in a stage."""
    if word == "RUN":
        stage.run(["/bin/sh", "-c", rest])
    elif word == "COPY":
        copied(stage, stages, context, rest)
    elif word == "WORKDIR":
        stage.folder = rest
        stage.place(rest).mkdir(parents=True, exist_ok=True)
    elif word == "USER":
        stage.user = rest
    elif word == "ENV":
        name, _, value = rest.partition("=")
        stage.environment[name] = value
    elif word == "ENTRYPOINT":
        stage.entry = json.loads(rest)
    elif word != "VOLUME":
        raise SystemExit(f"Dockerfile: {word} is not known here")


def base_of(work: Path) -> Path:
    """A Debian with Python, made once."""
    base = work / "base"
    if not base.is_dir():
        command = ["debootstrap", "--variant=minbase", f"--include={PACKAGES}", SUITE, str(base)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    for name in FROM_HOST:
        if Path("/", name).is_file():
            shutil.copy2(Path("/", name), base / name)
    return base


def checkout(folder: Path) -> Path:
    """The last commit's files."""
    shutil.rmtree(folder, ignore_errors=True)
    archive = subprocess.run(
        ["git", "-C", str(SOURCE), "archive", "HEAD"], check=True, capture_output=True
    ).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        tar.extractall(folder, filter="data")
    return folder


def main() -> int:
    """Builds all stages and runs the last one's entry point."""
    parser = argparse.ArgumentParser(description="The Dockerfile's steps in clean roots.")
    parser.add_argument("work", type=Path, help="folder for the roots, 3 GB")
    parser.add_argument("arguments", nargs="*", help="of the entry point")
    options = parser.parse_args()
    if pwd.getpwuid(os.getuid()).pw_name != "root" or not shutil.which("debootstrap"):
        print("needs root and debootstrap", file=sys.stderr)
        return 2
    options.work.mkdir(parents=True, exist_ok=True)
    base, context = base_of(options.work), checkout(options.work / "context")
    stages: dict[str, Stage] = {}
    stage = Stage(base)
    for word, rest in instructions((SOURCE / "Dockerfile").read_text()):
        print(f"{word} {rest}", flush=True)
        if word == "FROM":
            name = rest.split(" AS ")[1] if " AS " in rest else f"stage{len(stages)}"
            stage = stages[name] = new_stage(base, options.work, name)
        else:
            step(stage, stages, context, word, rest)
    command = stage.entry + options.arguments
    print(f"as {stage.user}: {shlex.join(command)}", flush=True)
    stage.run(command)
    return 0


if __name__ == "__main__":
    sys.exit(main())
