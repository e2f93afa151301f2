"""The picture of a race: what its arms have found, over the seconds."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from mdpo_rddl.machine.pictures import literal

_INCUMBENT_COLOUR = "#c8553d"
_COLOURS = ("#1f6f8b", "#e0a030", "#5b7553", "#7d5a91", "#7fb7be", "#b07aa1", "#8c6d46", "#444444")
_MARKERS = "osD^vP*X"


def draw_race(path: Path, race: Mapping[str, Any], title: str) -> None:
    """Draws the incumbent as a step line, candidates as points, no-op and random as lines.

    Args:
      path: the picture's file.
      race: what `summary.json` holds of the race.
      title: the picture's title.
    """
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    _draw_incumbent(axes, race["candidates"])
    for number, arm in enumerate(dict.fromkeys(point["arm"] for point in race["candidates"])):
        points = [p for p in race["candidates"] if p["arm"] == arm and _is_finite(p)]
        axes.errorbar(
            [point["seconds"] for point in points],
            [point["mean_return"] for point in points],
            yerr=[point["error"] or 0.0 for point in points],
            fmt=_MARKERS[number % len(_MARKERS)],
            color=_COLOURS[number % len(_COLOURS)],
            markersize=5.0,
            linewidth=1.0,
            label=literal(arm),
        )
    for name, line in (("noop_return", "--"), ("random_return", ":")):
        if race[name] is not None:
            label = name.removesuffix("_return").replace("noop", "no-op")
            axes.axhline(race[name], color="#777777", linestyle=line, linewidth=1.0, label=label)
    axes.set(xlabel="wall-clock time (s)", ylabel="return on the exact model")
    axes.set_xlim(left=0.0)
    axes.set_title(title, parse_math=False)  # a file's name may hold dollar signs
    axes.yaxis.set_major_formatter(EngFormatter())
    axes.grid(alpha=0.25)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=130)


def _draw_incumbent(axes: Axes, candidates: list[Mapping[str, Any]]) -> None:
    steps = [point for point in candidates if point["became_incumbent"] and _is_finite(point)]
    if not steps:
        return
    seconds = [point["seconds"] for point in steps] + [candidates[-1]["seconds"]]
    returns = [point["mean_return"] for point in steps] + [steps[-1]["mean_return"]]
    axes.step(
        seconds, returns, where="post", color=_INCUMBENT_COLOUR, linewidth=1.8, label="incumbent"
    )


def _is_finite(point: Mapping[str, Any]) -> bool:
    return point["mean_return"] is not None
