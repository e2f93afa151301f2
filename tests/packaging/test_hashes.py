"""What CI may install: the pinned versions, each with the hashes of its files."""

import re
import tomllib

from helpers.problems import ROOT
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PINNED = re.compile(r"^([\w.-]+)==(\S+)", re.MULTILINE)


def pins(name: str) -> dict[str, str]:
    text = (ROOT / name).read_text()
    return {canonicalize_name(found): version for found, version in PINNED.findall(text)}


def test_the_hashes_are_of_the_pinned_versions():
    pinned, hashed = pins("constraints.txt"), pins("constraints-hashes.txt")
    differing = {name: version for name, version in hashed.items() if pinned[name] != version}
    assert differing == {}, "run `make hashes`"


def test_each_package_has_hashes():
    entries = re.split(r"^(?=\S)", (ROOT / "constraints-hashes.txt").read_text(), flags=re.M)[1:]
    assert len(entries) > 100
    bare = [entry for entry in entries if not re.search(r"--hash=sha256:[0-9a-f]{64}\b", entry)]
    assert bare == []


def test_all_that_the_package_needs_is_among_them():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    hashed = pins("constraints-hashes.txt")
    extras = project["optional-dependencies"]
    wanted = list(project["dependencies"])
    for extra in ("dev", "tuning", "slurm", "docs", "dist"):
        wanted += extras[extra]
    names = {canonicalize_name(Requirement(text).name) for text in wanted}
    assert names - {"mdpo-rddl"} <= set(hashed)
