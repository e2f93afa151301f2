"""Pictures of a run's scores."""

import io

import numpy as np
from matplotlib.figure import Figure

from mdpo_rddl.ipc.names import FLOOR
from mdpo_rddl.ipc.score import Scores
from mdpo_rddl.machine.pictures import literal

_MOST_DOMAINS, _MOST_PLANNERS = 60, 20
_COLOURS = ("#c8553d", "#1f6f8b", "#7fb7be", "#9aa5b1", "#d9c27e", "#5b7553", "#7d5a91")


def draw_domains(scores: Scores) -> bytes:
    """Bars: the mean normalised score of each domain and planner, as a PNG.

    Of more than sixty domains or twenty planners only the first; the report's tables have all.
    """
    domains = [name for name, row in scores.domains.items() if row][:_MOST_DOMAINS]
    planners = _drawn(scores)
    width = 0.8 / len(planners)
    figure = Figure(figsize=(max(6.0, 1.4 * len(domains)), 3.8), layout="constrained")
    axes = figure.subplots()
    for number, name in enumerate(planners):
        places = np.arange(len(domains)) + (number - (len(planners) - 1) / 2) * width
        heights = [scores.domains[domain].get(name, 0.0) for domain in domains]
        axes.bar(places, heights, width, label=literal(name), color=_colour(number))
    axes.set_xticks(range(len(domains)), [literal(_short(domain)) for domain in domains])
    axes.set(ylabel="normalised score", ylim=(0, 1.02))
    axes.grid(axis="y", alpha=0.25)
    axes.legend(frameon=False, ncols=len(planners), loc="lower center", bbox_to_anchor=(0.5, 1))
    return _png(figure)


def draw_profiles(scores: Scores) -> bytes:
    """Performance profiles: the share of instances with at least a given score, as a PNG."""
    figure = Figure(figsize=(6.0, 3.8), layout="constrained")
    axes = figure.subplots()
    levels = np.linspace(0.0, 1.0, 201)
    for number, name in enumerate(_drawn(scores)):
        found = [row[name].normalised for row in scores.cells.values() if name in row]
        values = np.array([value for value in found if value is not None])
        if len(values):
            share = np.mean(values[:, np.newaxis] >= levels, axis=0)
            axes.step(levels, share, label=literal(name), color=_colour(number))
    axes.set(xlabel="normalised score of at least", ylabel="share of instances", ylim=(0, 1.02))
    axes.grid(alpha=0.25)
    axes.legend(frameon=False, loc="lower left")
    return _png(figure)


def _drawn(scores: Scores) -> list[str]:
    """All but the players that are worth 0 by definition, if there are others."""
    others = [name for name in scores.planners if name not in FLOOR]
    return (others or list(scores.planners))[:_MOST_PLANNERS]


def _colour(number: int) -> str:
    return _COLOURS[number % len(_COLOURS)]


def _short(domain: str) -> str:
    return domain.removesuffix("_ippc2023")


def _png(figure: Figure) -> bytes:
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=130)
    return content.getvalue()
