"""The live table of a run, read from its folder, wherever the work is done."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from mdpo_rddl.ipc.results import EntryResult, load_result
from mdpo_rddl.ipc.rules import Entry, Instance, Rules
from mdpo_rddl.ipc.tables import format_return
from mdpo_rddl.ipc.trial import OK

# the table's own lines
_FRAME = 9


class LiveTable:
    """Shows on standard error what is done and what leads; for use in a `with` block."""

    def __init__(self, root: Path, entries: Sequence[Entry], rules: Rules, shown: bool) -> None:
        """Reads nothing yet.

        Args:
          root: the run's folder.
          entries: all of the run.
          rules: of the run.
          shown: whether to show anything.
        """
        self._root, self._entries, self._rules = root, entries, rules
        self._complete: dict[Entry, EntryResult] = {}
        self._console = Console(stderr=True)
        self._live = Live(
            console=self._console,
            get_renderable=self.table,
            refresh_per_second=1,
            auto_refresh=True,
        )
        self._shown = shown

    def __enter__(self) -> "LiveTable":
        if self._shown:
            self._live.start(refresh=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._shown:
            self._live.stop()

    def table(self) -> Table:
        """The table as the folder stands now."""
        results = {entry: self._result(entry) for entry in self._entries}
        complete = sum(result.is_complete for result in results.values())
        trials = sum(len(result.trials) for result in results.values())
        table = Table(
            title=f"{complete} of {len(results)} entries, {trials:,} trials",
            caption="mean return so far, of how many trials; the leader is bold",
            show_footer=True,
        )
        planners = list(dict.fromkeys(entry.planner for entry in self._entries))
        table.add_column("instance", "leads on", no_wrap=True)
        for name in planners:
            table.add_column(escape(name), justify="right", no_wrap=True)
        rows: dict[Instance, dict[str, EntryResult]] = {}
        for entry, result in results.items():
            rows.setdefault(entry.problem, {})[entry.planner] = result
        leads = Counter(name for row in rows.values() for name in _leaders(row))
        for column, name in zip(table.columns[1:], planners, strict=True):
            column.footer = str(leads[name])
        for problem in _worth_showing(rows)[-max(1, self._console.height - _FRAME) :]:
            label = escape(f"{problem.domain_label} {problem.label}")
            table.add_row(label, *_cells(rows[problem], planners))
        return table

    def _result(self, entry: Entry) -> EntryResult:
        if entry in self._complete:
            return self._complete[entry]
        result = load_result(self._root, entry, self._rules.trials)
        if result.is_complete:
            self._complete[entry] = result
        return result


def _is_begun(result: EntryResult) -> bool:
    return result.preparation is not None


def _worth_showing(rows: Mapping[Instance, Mapping[str, EntryResult]]) -> list[Instance]:
    """The instances that are done or begun, and the first that is neither."""
    shown = []
    for problem, row in rows.items():
        shown.append(problem)
        if not any(map(_is_begun, row.values())):
            break
    return shown


def _leaders(row: Mapping[str, EntryResult]) -> list[str]:
    means = {name: mean for name, result in row.items() if (mean := _mean(result)) is not None}
    return [name for name, mean in means.items() if mean == max(means.values())]


def _cells(row: Mapping[str, EntryResult], planners: Sequence[str]) -> list[str]:
    leaders, cells = _leaders(row), []
    for name in planners:
        result = row[name]
        mean = _mean(result)
        failure = _failure(result)
        if failure:
            cells.append(f"[red]{failure}[/red]")
        elif mean is None:
            cells.append("ready" if _is_begun(result) else "")
        else:
            done = "" if result.is_complete else f" [dim]{len(result.trials)}[/dim]"
            text = format_return(mean)
            cells.append((f"[bold green]{text}[/bold green]" if name in leaders else text) + done)
    return cells


def _mean(result: EntryResult) -> float | None:
    totals = [trial.total for trial in result.trials if trial.total is not None]
    return float(np.mean(totals)) if totals and not _failure(result) else None


def _failure(result: EntryResult) -> str:
    if result.preparation is not None and result.preparation.status != OK:
        return result.preparation.status
    return next((trial.status for trial in result.trials if trial.status != OK), "")
