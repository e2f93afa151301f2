"""The page of a run, or one that compares several, as HTML."""

from collections.abc import Mapping, Sequence
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined

from mdpo_rddl.session.report.page.charts import (
    draw_decision_times,
    draw_distribution,
    draw_returns,
    draw_searches,
)
from mdpo_rddl.session.report.page.panels import Series, draw_panels
from mdpo_rddl.session.report.page.record import RunRecord
from mdpo_rddl.session.report.page.results import (
    ResultRow,
    are_comparable,
    compared,
    result_rows,
    returns_of,
)
from mdpo_rddl.session.report.page.style import (
    NOOP_COLOUR,
    POLICY_COLOUR,
    SERIES_COLOURS,
    Picture,
    stored_picture,
)


def run_page(run: RunRecord, name: str | None = None) -> str:
    """The page of one run.

    Args:
      run: what its folder holds.
      name: what to call it, if not as the folder.
    """
    summary, seconds = run.summary, run.decision_seconds
    rows = result_rows(run)
    series = [
        Series(label, colour, key == "noop", run.plays[key])
        for key, label, colour in (
            ("policy", rows[0].returns.name, POLICY_COLOUR),
            ("noop", "no-op", NOOP_COLOUR),
        )
        if key in run.plays
    ]
    thinking = summary.get("thinking") or {}
    budget = thinking.get("decision_seconds") or summary.get("decision_seconds")
    return _template("run.html.j2").render(
        name=name or run.name,
        run=run,
        summary=summary,
        rows=rows,
        returns=_returns(rows),
        race=_race(run),
        rule=summary.get("rule"),
        series=series,
        fluents=draw_panels(series),
        search=_stored(run, "learning_curve.png", "the search for the policy"),
        noise=_stored(run, "noise.png", "noise per step and iteration", is_wide=True),
        decisions=None if seconds is None else draw_decision_times(seconds, budget),
        times=None if seconds is None else _times(seconds),
        thinking=thinking,
        sections=(run.config or {}).get("sections") or {},
    )


def comparison_page(runs: Sequence[RunRecord]) -> str:
    """The page that compares several runs with the first one of them.

    Args:
      runs: at least two; of several problems too, each then with its own returns alone.
    """
    colours = [SERIES_COLOURS[number % len(SERIES_COLOURS)] for number in range(len(runs))]
    returns = [
        returns_of(run.name, colour, run.summary) for run, colour in zip(runs, colours, strict=True)
    ]
    first, is_same = runs[0], are_comparable(runs)
    rows = [
        compared(returns[0], row) if number and are_comparable([first, run]) else ResultRow(row)
        for number, (run, row) in enumerate(zip(runs, returns, strict=True))
    ]
    groups: dict[tuple[str, ...], list[int]] = {}
    for number, run in enumerate(runs):
        groups.setdefault(_problem(run), []).append(number)
    alike = [(r, c) for r, c in zip(runs, colours, strict=True) if _has_fluents_of(first, r)]
    series = [Series(run.name, colour, False, run.plays["policy"]) for run, colour in alike]
    pictures = []
    for (label, *_), numbers in groups.items():
        pictures.append(draw_returns([returns[number] for number in numbers], label))
        races = {
            runs[number].name: (colours[number], race["candidates"])
            for number in numbers
            if (race := _race(runs[number])) is not None
        }
        if races:
            pictures.append(draw_searches(races, label))
    return _template("comparison.html.j2").render(
        runs=runs,
        rows=rows,
        is_same=is_same,
        pictures=pictures,
        series=series,
        fluents=draw_panels(series),
    )


def _problem(run: RunRecord) -> tuple[str, ...]:
    """The label of a run's problem, and what else says which problem it is."""
    return tuple(str(run.summary[key]) for key in ("label", "domain", "instance", "horizon"))


def _has_fluents_of(first: RunRecord, other: RunRecord) -> bool:
    """Whether two runs have recorded the same fluents of the same objects."""
    if "policy" not in first.plays or "policy" not in other.plays:
        return False
    return (
        _problem(first) == _problem(other)
        and first.plays["policy"].fluents == other.plays["policy"].fluents
    )


def _returns(rows: Sequence[ResultRow]) -> list[Picture]:
    """The returns of all, and the distribution of the policy's if its episodes differ."""
    pictures = [draw_returns([row.returns for row in rows])]
    if np.ptp(rows[0].returns.returns) > 0.0:
        pictures.append(draw_distribution(rows[0].returns))
    return pictures


def _race(run: RunRecord) -> Mapping[str, Any] | None:
    """What the summary says of the race; None before version 0.2, which had no arms."""
    race = run.summary.get("auto")
    return race if race and "arms" in race else None


def _times(seconds: np.ndarray) -> Mapping[str, float]:
    """Decision times in milliseconds."""
    return {
        "mean": 1e3 * float(seconds.mean()),
        "99th percentile": 1e3 * float(np.quantile(seconds, 0.99)),
        "maximum": 1e3 * float(seconds.max()),
    }


def _stored(run: RunRecord, name: str, text: str, is_wide: bool = False) -> Picture | None:
    png = run.pictures.get(name)
    return None if png is None else stored_picture(png, text, is_wide)


@cache
def _environment() -> Environment:
    templates = resources.files("mdpo_rddl.session.report.page")
    environment = Environment(
        loader=FunctionLoader(lambda name: (templates / name).read_text(encoding="utf-8")),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["median"] = np.median
    environment.filters |= {"number": _number, "interval": _interval}
    environment.filters["change"] = lambda cost: ("+" if cost < 0 else "") + _number(-cost)
    return environment


def _template(name: str) -> Any:
    return _environment().get_template(name)


def _number(value: float | None) -> str:
    """A number to read: two digits after the point, none of a large one."""
    if value is None or not np.isfinite(value):
        return "not finite"
    if abs(value) >= 1e4:
        return f"{value:z,.0f}"
    return f"{value:z,.2f}" if abs(value) >= 1 or value == 0 else f"{value:z.3g}"


def _interval(bounds: tuple[float, float] | None) -> str:
    return "" if bounds is None else f"[{_number(bounds[0])}, {_number(bounds[1])}]"
