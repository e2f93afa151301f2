"""The paper's figures, drawn from our results."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from benchmarks.common.names import SETTINGS
from benchmarks.paper.landscape import Landscape
from benchmarks.paper.names import ADAPTIVE, METHODS
from benchmarks.paper.tables import Key, Measured
from mdpo_rddl.machine.pictures import write_picture

# Okabe and Ito's colours, which colour-blind readers can tell apart
STYLES: dict[str, tuple[str, str]] = {
    "adaptive": ("#009e73", "-"),
    "constant-1": ("#56b4e9", "--"),
    "constant-3": ("#d55e00", "--"),
    "deterministic": ("#0072b2", "-."),
    "jaxplan": ("#000000", ":"),
    "ppo": ("#e69f00", "-."),
}
_LARGEST = ("powergen11", "hvac20", "reservoir30")


def draw_landscapes(path: Path, landscape: Landscape) -> None:
    """Draws the return over two constant actions, one picture per model."""
    names = list(landscape.returns)
    figure = Figure(figsize=(4.0 * len(names), 3.6), layout="constrained")
    row = figure.subplots(1, len(names), squeeze=False)
    for axes, name in zip(row[0], names, strict=True):
        values = landscape.returns[name]
        mesh = axes.pcolormesh(
            landscape.actions, landscape.actions, values.T, cmap="viridis", shading="nearest"
        )
        best = np.unravel_index(np.argmax(values), values.shape)
        axes.plot(
            *landscape.actions[list(best)], "*", color="white", markeredgecolor="black", ms=12
        )
        title = "exact model" if name == "exact" else f"relaxed, {name}"
        axes.set(title=title, xlabel="production of p1 (units)", ylabel="production of p2 (units)")
        figure.colorbar(mesh, ax=axes, label="return", format=EngFormatter())
    figure.suptitle("Return of constant actions, two plants, 120 days (star: the best)")
    _save(figure, path)


def draw_learning_curves(path: Path, measured: Mapping[Key, Measured], over_time: bool) -> None:
    """Draws mean and deviation over seeds of the exact test return, a panel per setting.

    Args:
      path: the picture's file.
      measured: the finished cells.
      over_time: against training seconds of all seeds, else against iterations.
    """
    settings = [s for s in SETTINGS if any(setting == s for setting, _ in measured)]
    columns = min(3, len(settings))
    rows = -(-len(settings) // columns)
    figure = Figure(figsize=(5.0 * columns, 3.4 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat[len(settings) :]:
        axes.set_visible(False)
    for axes, setting in zip(grid.flat, settings, strict=False):
        for method in METHODS:
            if (setting, method) in measured:
                _draw_curve(axes, measured[setting, method], method, over_time)
        axes.set(
            title=setting,
            xlabel="training time of all seeds together (s)" if over_time else "iteration",
            ylabel="return on the exact model",
        )
        if over_time:
            axes.set_xscale("log")
        axes.yaxis.set_major_formatter(EngFormatter())
        axes.grid(alpha=0.25)
    lines = {line.get_label(): line for axes in grid.flat for line in axes.get_lines()}
    names = [name for name in STYLES if name in lines]
    figure.legend(
        [lines[name] for name in names],
        names,
        loc="outside lower center",
        ncols=2 * columns,
        frameon=False,
    )
    _save(figure, path)


def _draw_curve(axes: Axes, cell: Measured, method: str, over_time: bool) -> None:
    trained = cell.trained
    x = trained.elapsed if over_time else trained.iterations
    mean, std = trained.returns.mean(axis=0), trained.returns.std(axis=0)
    colour, line = STYLES[method]
    axes.fill_between(x, mean - std, mean + std, color=colour, alpha=0.15, linewidth=0)
    axes.plot(x, mean, line, color=colour, linewidth=1.6, label=method)


def draw_noise(path: Path, measured: Mapping[Key, Measured]) -> None:
    """Draws adaptive noise per step, and per step and iteration, a column per setting.

    The paper's three settings if they are there, else all that are.
    """
    cells = {setting: cell for (setting, m), cell in measured.items() if m == ADAPTIVE}
    settings = [s for s in _LARGEST if s in cells] or list(cells)
    if not settings:
        return
    figure = Figure(figsize=(5.0 * len(settings), 6.4), layout="constrained")
    grid = figure.subplots(2, len(settings), squeeze=False)
    for (profile, heat), setting in zip(grid.T, settings, strict=True):
        trained = cells[setting].trained
        assert trained.sigma is not None
        _draw_profile(profile, trained.sigma, setting)
        edges = [0, *trained.iterations]
        steps = np.arange(trained.sigma.shape[1] + 1)
        mesh = heat.pcolormesh(edges, steps, trained.sigma.T, cmap="viridis", vmin=0.0)
        heat.set(xlabel="iteration", ylabel="time step")
        figure.colorbar(mesh, ax=heat, label="sigma (action units)")
    figure.suptitle("Adaptive noise, mean over seeds")
    _save(figure, path)


def _draw_profile(axes: Axes, sigma: np.ndarray, title: str) -> None:
    colour, _ = STYLES[ADAPTIVE]
    steps = np.arange(sigma.shape[1])
    low, high = np.quantile(sigma, [0.1, 0.9], axis=0)
    axes.fill_between(steps, low, high, color=colour, alpha=0.2, label="10% to 90% of iterations")
    axes.plot(steps, sigma.mean(axis=0), color=colour, label="mean over iterations")
    axes.set(title=title, xlabel="time step", ylabel="sigma (action units)")
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)


def _save(figure: Figure, path: Path) -> None:
    write_picture(figure, path, dpi=130)
