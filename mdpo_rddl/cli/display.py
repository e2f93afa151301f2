"""What the commands show on standard output: a table."""

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from mdpo_rddl.problem.evaluation import LOST

_REFERENCES = {"noop": "the no-op", "random": "random actions"}
_WIDE = 1e15


def print_summary(console: Console, summary: Mapping[str, Any], where: str | None) -> None:
    """Prints the summary's figures as a table."""
    table = Table(
        title=escape(f"{summary['label']}, horizon {summary['horizon']}"),
        min_width=60,
        show_header=False,
    )
    table.add_column("", no_wrap=True)
    table.add_column("", justify="right")
    table.add_row("policy", summary["policy"])
    if "auto" not in summary or summary["noise"] != "none":
        numbers = ", ".join(f"{key} {value}" for key, value in summary["noise_parameters"].items())
        table.add_row("action noise", summary["noise"] + (f" ({numbers})" if numbers else ""))
    table.add_row("seed", str(summary["seed"]))
    table.add_section()
    table.add_row("episodes, exact environment", str(summary["episodes"]))
    mean = _number(summary["mean_return"]) if summary["returns"] else "none was ended"
    table.add_row("mean return", f"[bold]{mean}[/bold]")
    if "optimum" in summary:
        table.add_row("proven optimum", f"[bold]{_number(summary['optimum']['value'])}[/bold]")
    if summary["ci95"] is not None:
        low, high = summary["ci95"]
        table.add_row("95% interval", f"\\[{_number(low)}, {_number(high)}]")
    table.add_row("standard deviation", _number(summary["std_return"]))
    _add_illegal(table, summary)
    if "last_iterate" in summary:
        table.add_row("mean return, last iterate", _number(summary["last_iterate"]["mean_return"]))
        table.add_section()
        table.add_row("iterations", f"{summary['iterations']:,} ({summary['status']})")
        table.add_row("best iterate", f"{summary['best_iteration']:,}")
        table.add_row("training", f"{summary['train_seconds']:.1f} s")
        table.add_row("compilation", f"{summary['compile_seconds']:.1f} s")
    if "auto" in summary:
        _add_race(table, summary)
    if "thinking" in summary:
        _add_thinking(table, summary["thinking"])
    if summary.get("mode") == "replan":
        _add_replanning(table, summary)
    console.print(table)
    if where is not None:
        console.print(f"written to {where}", highlight=False, markup=False, soft_wrap=True)


def _add_illegal(table: Table, summary: Mapping[str, Any]) -> None:
    """Adds what was illegal, and whether the plan can be executed at all."""
    if summary["illegal_actions"]:
        counts = (
            f"{summary['illegal_actions']:,}, of which {summary['fallback_actions']:,} fell back"
        )
        table.add_row("[red]steps with an illegal action[/red]", counts)
    if summary.get("unplayable_steps"):
        of = f"no legal action at {summary['unplayable_steps']:,} of {summary['steps']:,} steps"
        table.add_row("[red]cannot be executed[/red]", of)
        for text in summary["unmet_preconditions"]:
            table.add_row("[red]precondition in the way[/red]", escape(text))
    for name, figures in (summary.get("references") or {}).items():
        if figures is not None and figures["illegal_actions"]:
            of = f"{figures['illegal_actions']:,} of {figures['steps']:,}"
            table.add_row(f"illegal steps of {_REFERENCES[name]}", of)


def _add_replanning(table: Table, summary: Mapping[str, Any]) -> None:
    """Adds how decisions were made, if there were any."""
    table.add_section()
    table.add_row("decisions", f"{summary['decisions']:,}, {summary['lookahead']} steps ahead")
    table.add_row("budget of a decision", f"{summary['decision_seconds']:g} s")
    if summary["decisions"]:
        used = f"{summary['mean_seconds']:.2f} s (longest {summary['max_seconds']:.2f} s)"
        table.add_row("used, on average", used)
        table.add_row("iterations, on average", f"{summary['mean_iterations']:,.0f}")
    table.add_row("compilation, before", f"{summary['compile_seconds']:.1f} s")


def _add_race(table: Table, summary: Mapping[str, Any]) -> None:
    """Adds a row for each arm of a race, and which of them the result is from."""
    race = summary["auto"]
    table.add_section()
    result = race["chosen"]
    if race["parents"]:
        result += f", from {' and '.join(race['parents'])}"
    table.add_row("result", result)
    if "optimum" in summary:
        table.add_row("reachable states", f"{summary['optimum']['states']:,}")
    elif race["candidates"]:
        table.add_row("return of the no-op", _number(race["noop_return"]))
    for name, arm in race["arms"].items():
        best = "none" if arm["best_return"] is None else _number(arm["best_return"])
        mark = " *" if name == race["arm"] else ""
        figures = f"{arm['seconds']:.1f} s  {arm['iterations']:,} iterations  best {best}"
        table.add_row(f"{name}{mark}", figures)
    if race["late_gain"] is not None:
        table.add_row("gained in the last half", f"{race['late_gain']:.1%} of all gains")
    seconds = summary["train_seconds"] + summary["compile_seconds"]
    compiling = summary["compile_seconds"]
    told = f", {compiling:.1f} s of it compilation" if compiling else ""
    table.add_row("in all", f"{seconds:.1f} s{told} ({summary['status']})")


def _add_thinking(table: Table, thinking: Mapping[str, Any]) -> None:
    """Adds how decisions were made, and what that has gained."""
    table.add_section()
    table.add_row("time of a decision", f"{thinking['decision_seconds']:g} s")
    table.add_row("preparing to think", f"{thinking['prepare_seconds']:.1f} s")
    if thinking["method"] is None:
        tried = [trial["mean_gain"] is not None for trial in thinking["trials"]]
        why = "does not pay" if any(tried) else "no time to find out whether it pays"
        table.add_row("thinking", thinking["reason"] or f"{why}, so the policy plays alone")
        return
    table.add_row("thinking", thinking["method"])
    used = f"{thinking['mean_seconds']:.3f} s (longest {thinking['max_seconds']:.3f} s)"
    table.add_row("used, on average", used)
    table.add_row("policy's action left", f"{thinking['left_base']:,} of {thinking['decisions']:,}")
    if thinking["replaced"]:
        table.add_row("[red]illegal, replaced[/red]", f"{thinking['replaced']:,}")
    table.add_row("mean return, policy alone", _number(thinking["plain_mean_return"]))
    gain = f"{_number(thinking['realised_gain'])} (expected {_number(thinking['expected_gain'])})"
    table.add_row("gain of an episode", gain)


def _number(value: float | None) -> str:
    """Two digits after the point; of what would fill the line six in all."""
    if value is None:
        return "not finite"
    if value <= LOST:
        return "lost"
    return f"{value:z,.2f}" if abs(value) < _WIDE else f"{value:.6g}"
