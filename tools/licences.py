"""The licence of every package that this project's installation brings, as a Markdown table.

    python tools/licences.py            # of the packages that are installed beside it
    python tools/licences.py --check    # whether each of constraints.txt has one; status 1 if not

Run it with the Python of the project's environment. What a package says of itself is shown.
"""

import argparse
import importlib.metadata
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_LONGEST = 60


def pinned() -> list[str]:
    """The names in constraints.txt."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return [line.partition("==")[0] for line in lines if "==" in line]


def licence(name: str) -> str:
    """What a package says, in one line; empty if it is not installed."""
    try:
        about = importlib.metadata.metadata(name)
    except importlib.metadata.PackageNotFoundError:
        return ""
    classifiers = [
        text.rpartition(":: ")[2]
        for text in about.get_all("Classifier", [])
        if text.startswith("License ::") and not text.endswith("OSI Approved")
    ]
    said = about.get("License-Expression") or ", ".join(classifiers) or about.get("License") or ""
    first = re.sub(r"\s+", " ", said.strip().partition("\n")[0])
    return first[:_LONGEST] or "none given"


def main() -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    found = {name: licence(name) for name in pinned()}
    if options.check:
        unknown = [name for name, said in found.items() if said == "none given"]
        print("\n".join(unknown), end="\n" if unknown else "")
        return int(bool(unknown))
    print("| package | version | licence |\n|---|---|---|")
    for name, said in found.items():
        if said:
            print(f"| {name} | {importlib.metadata.version(name)} | {said} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
