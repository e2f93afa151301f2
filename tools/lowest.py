"""Prints a constraints file with the oldest versions that pyproject.toml allows.

    python tools/lowest.py > lowest.txt

What has no lower bound of its own, because another package brings it, is left to pip.
"""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
# the extras that the smoke tests need
EXTRAS = ("dev",)


def lowest(requirement: str) -> str:
    """`name>=1.2,<3` as `name==1.2`.

    Raises:
      ValueError: if it has no lower bound.
    """
    found = re.fullmatch(r"([\w.-]+)>=([\w.]+)(,.*)?", requirement.replace(" ", ""))
    if found is None:
        raise ValueError(f"pyproject.toml: {requirement}: no lower bound")
    return f"{found[1]}=={found[2]}"


def main() -> None:
    """Prints one line for each requirement."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    requirements = list(project["dependencies"])
    for extra in EXTRAS:
        requirements += project["optional-dependencies"][extra]
    # what analyses the code does not run it
    analysers = ("ruff", "mypy")
    print("\n".join(lowest(r) for r in requirements if not r.startswith(analysers)))


if __name__ == "__main__":
    main()
