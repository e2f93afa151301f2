"""Whether the exact environment pays what the judge's rollouts have promised.

Both play by the same rules, the environment in 64 bit. Where a rule has a threshold, as a least
production above which a plant counts as on, a policy may be found that sits exactly on it, and
rounding then decides.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from mdpo_rddl.problem.evaluation import Evaluation

if TYPE_CHECKING:
    from mdpo_rddl.auto.candidate import Candidate

# of the difference's standard error, and of the return
_ERRORS, _SHARE = 4.0, 0.01


def less_than_judged(chosen: "Candidate", played: Evaluation) -> str:
    """A warning if the environment has paid less; empty if it has not.

    Args:
      chosen: a candidate; nothing is said of one that no rollouts were made of.
      played: its episodes on the exact environment; nothing is said of a single one.
    """
    count = len(played.returns)
    if count < 2 or chosen.returns is None or chosen.mean is None:
        return ""
    error = float(np.std(played.returns, ddof=1)) / math.sqrt(count)
    least = _ERRORS * math.hypot(error, chosen.error) + _SHARE * abs(chosen.mean)
    if not played.mean < chosen.mean - least:
        return ""
    return (
        f"the exact environment paid {played.mean:,.6g} where the judge's rollouts had "
        f"{chosen.mean:,.6g}: the policy may sit on a threshold, where rounding decides; try "
        "another --seed"
    )
