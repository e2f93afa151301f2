"""A toy problem that is trained in seconds, and whether two runs of it have found the same."""

from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

DOMAIN = """
domain shelves {
    types { shelf : object; };
    pvariables {
        stock(shelf) : { state-fluent, real, default = 4.0 };
        order(shelf) : { action-fluent, real, default = 0.0 };
    };
    cpfs { stock'(?s) = max[0.0, stock(?s) + order(?s) - Uniform(0.0, 2.0)]; };
    reward = -(sum_{?s : shelf} [abs[stock'(?s) - 3.0]]);
    action-preconditions { forall_{?s : shelf} [order(?s) >= 0.0 ^ order(?s) <= 2.0]; };
}
"""
INSTANCE = """
non-fluents nf { domain = shelves; objects { shelf : {s1, s2, s3}; }; }
instance three {
    domain = shelves; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 12;
    discount = 1.0;
}
"""


def write_problem(folder: Path) -> list[str]:
    """The domain's and the instance's file."""
    files = {"shelves.rddl": DOMAIN, "three.rddl": INSTANCE}
    for name, text in files.items():
        (folder / name).write_text(text)
    return [str(folder / name) for name in files]


def same(left: Path, right: Path) -> bool:
    """Whether two runs found the same, bit for bit.

    Which iterations are recorded depends on how many the machine manages in a second, for unbroken
    runs too: those that both have recorded are compared, the last one among them.
    """
    ours, theirs = (load_file(folder / "policy.safetensors") for folder in (left, right))
    params = ours.keys() == theirs.keys()
    params = params and all((ours[name] == theirs[name]).all() for name in ours)
    one, other = records(left), records(right)
    common = one.keys() & other.keys()
    return params and max(one) in common and all(one[each] == other[each] for each in common)


def records(folder: Path) -> dict[int, tuple[str, bytes]]:
    """Per recorded iteration its row of the history and of the noise."""
    rows = (folder / "history.csv").read_text().splitlines()[1:]
    noise = np.load(folder / "noise.npy", allow_pickle=False)
    return {
        int(row.split(",")[0]): (row, sigma.tobytes())
        for row, sigma in zip(rows, noise, strict=True)
    }
