"""Draws an episode under the no-op policy beside the same episode under a saved policy.

    python tools/trajectories.py RUN PICTURE   # RUN: a run folder of mdpo-plan or a policy file

Both episodes are on the exact environment with one seed. Of the state fluents the one is drawn
that differs most between them, relative to its range.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from mdpo_rddl import Problem, load_policy, make_environment
from mdpo_rddl.ipc.traces import Trace
from mdpo_rddl.problem.episode import Episode
from mdpo_rddl.problem.legality import Referee

COLOURS = {"no-op": "#9aa5b1", "policy": "#1f6f8b"}
MOST_LINES = 40
SEED = 1

Arrays = dict[str, np.ndarray]


def played(problem: Problem, act: Callable[[int, Any], Any]) -> Arrays:
    """One episode: "reward" [T], and per fluent "state/NAME" and "action/NAME" [T, *shape]."""
    env, trace = make_environment(problem), Trace()
    Episode(env, act, Referee(env), trace).play(env.reset(seed=SEED)[0])
    return trace.arrays()


def both(policy: Any) -> dict[str, Arrays]:
    """The episode under the no-op and under the policy."""
    return {
        "no-op": played(policy.problem, lambda step, state: {}),
        "policy": played(policy.problem, policy),
    }


def telling_fluent(episodes: dict[str, Arrays]) -> str:
    """The key of the numeric state fluent in which the two episodes differ most."""
    first, second = episodes.values()
    found = {}
    for key, values in first.items():
        if not key.startswith("state/") or values.dtype.kind not in "bif":
            continue
        steps = min(len(values), len(second[key]))
        one, other = values[:steps].astype(float), second[key][:steps].astype(float)
        spread = max(np.nanmax(one), np.nanmax(other)) - min(np.nanmin(one), np.nanmin(other))
        found[key] = np.nanmean(np.abs(one - other)) / spread if spread > 0.0 else 0.0
    return max(found, key=lambda key: found[key])


def shown(value: float) -> str:
    """A return as it is written: whole where it is large."""
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.4g}"


def draw(path: Path, title: str, episodes: dict[str, Arrays]) -> None:
    """Writes the picture: the fluent under each of both, and the return so far."""
    key = telling_fluent(episodes)
    name = key.removeprefix("state/")
    figure = Figure(figsize=(10.5, 2.9), layout="constrained")
    *states, rewards = figure.subplots(1, 3)
    values = {label: episode[key].astype(float) for label, episode in episodes.items()}
    low = min(np.nanmin(each) for each in values.values())
    high = max(np.nanmax(each) for each in values.values())
    for axes, (label, each) in zip(states, values.items(), strict=True):
        flat = each.reshape(len(each), -1)
        if flat.shape[1] > MOST_LINES or (episodes[label][key].dtype == bool and each.ndim > 1):
            axes.imshow(flat.T, aspect="auto", vmin=low, vmax=high, cmap="Blues", origin="lower")
            axes.set_ylabel(f"{name}, by object")
        else:
            axes.plot(flat, color=COLOURS[label], linewidth=0.9, alpha=0.8)
            margin = 0.05 * (high - low or 1.0)
            axes.set_ylim(low - margin, high + margin)
            axes.set_ylabel(name)
        axes.set(title=label, xlabel="step")
    for label, episode in episodes.items():
        total = np.cumsum(episode["reward"])
        rewards.plot(total, color=COLOURS[label], label=f"{label}: {shown(total[-1])}")
    rewards.set(title="return so far", xlabel="step")
    rewards.yaxis.set_major_formatter(EngFormatter())
    rewards.legend(frameon=False, fontsize=8)
    for axes in (*states, rewards):
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(title, parse_math=False, fontsize=10)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Draws the picture of a run."""
    run, picture = map(Path, sys.argv[1:])
    policy = load_policy(run)
    draw(picture, policy.problem.label, both(policy))


if __name__ == "__main__":
    main()
