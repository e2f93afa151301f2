"""Pictures of one run: its learning curve and its noise."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from mdpo_rddl.planner.training.training import Record

TRAIN_COLOUR = "#9aa5b1"
TEST_COLOUR = "#1f6f8b"
BEST_COLOUR = "#c8553d"


def draw_learning_curve(
    path: Path, history: Sequence[Record], best_iteration: int, title: str
) -> None:
    """Draws the relaxed training return and the exact test return over iterations."""
    iterations = [record.iteration for record in history]
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.plot(
        iterations,
        [record.train_return for record in history],
        color=TRAIN_COLOUR,
        linewidth=0.8,
        label="training (relaxed model, with noise)",
    )
    axes.plot(
        iterations,
        [record.test_return for record in history],
        color=TEST_COLOUR,
        linewidth=1.8,
        label="test (exact model, no noise, rolling mean)",
    )
    axes.axvline(
        best_iteration, color=BEST_COLOUR, linestyle="--", linewidth=1.0, label="best iterate"
    )
    axes.set(xlabel="iteration", ylabel="return")
    axes.set_title(title, parse_math=False)  # a file's name may hold dollar signs
    axes.yaxis.set_major_formatter(EngFormatter())
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)
    _save(figure, path)


def draw_noise(path: Path, sigma: np.ndarray, iterations: Sequence[int], title: str) -> None:
    """Draws sigma over time steps, and over time steps and iterations.

    Args:
      path: the picture's file.
      sigma: scale of the noise per recorded iteration and step [recorded, H], in the
        unit of its rule.
      iterations: the recorded iterations [recorded].
      title: the picture's title.
    """
    steps = np.arange(sigma.shape[1])
    figure = Figure(figsize=(11.0, 4.0), layout="constrained")
    profile, heat = figure.subplots(1, 2)
    low, high = np.quantile(sigma, [0.1, 0.9], axis=0)
    profile.fill_between(
        steps, low, high, color=TEST_COLOUR, alpha=0.2, label="10% to 90% of iterations"
    )
    profile.plot(steps, sigma.mean(axis=0), color=TEST_COLOUR, label="mean over iterations")
    profile.set(xlabel="time step", ylabel="sigma", title="mean noise per step")
    profile.set_ylim(bottom=0.0)
    profile.grid(alpha=0.25)
    profile.legend(frameon=False)

    edges = [*iterations, iterations[-1] + 1]
    mesh = heat.pcolormesh(edges, np.arange(sigma.shape[1] + 1), sigma.T, cmap="viridis", vmin=0.0)
    heat.set(xlabel="iteration", ylabel="time step", title="noise per step and iteration")
    figure.colorbar(mesh, ax=heat, label="sigma (unit of the noise)")
    figure.suptitle(title, parse_math=False)
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    figure.savefig(path, dpi=130)
