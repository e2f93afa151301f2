"""The tables of a run's report, in Markdown."""

from collections.abc import Callable, Iterable, Mapping, Sequence

from mdpo_rddl.ipc.names import JAXPLAN
from mdpo_rddl.ipc.rules import Instance
from mdpo_rddl.ipc.score import EntryScore, Scores

_NONE = "–"


def overall_table(by_mode: Mapping[str, Scores]) -> list[str]:
    """Per planner: the overall score, what it won and what it failed."""
    strict = by_mode["strict"]
    heads = [f"{mode} score" for mode in by_mode]
    rows = []
    for name in strict.planners:
        cells = [row[name] for row in strict.cells.values() if name in row]
        scores = [_score(scores.overall.get(name)) for scores in by_mode.values()]
        won = f"{strict.count(name, best_only=True)}", f"{strict.count(name)} of {len(cells)}"
        failed = f"{sum(bool(cell.failure) for cell in cells)}"
        trials = f"{sum(cell.failed_trials for cell in cells):,}"
        violations = f"{sum(cell.violations for cell in cells):,}"
        rows.append([name, *scores, *won, failed, trials, violations])
    if set(JAXPLAN) <= set(strict.planners):
        better = [_score(scores.better_of(JAXPLAN)) for scores in by_mode.values()]
        rows.append(["JaxPlan's better one on each instance", *better, *([""] * 5)])
    columns = ["best", "best or level", "failed instances", "failed trials", "illegal actions"]
    return table(["planner", *heads, *columns], rows)


def domain_table(by_mode: Mapping[str, Scores]) -> list[str]:
    """Per domain and planner: the mean normalised score."""
    strict = by_mode["strict"]

    def value(domain: str, name: str) -> str:
        return _both(by_mode, lambda scores: scores.domains[domain].get(name))

    rows = [[domain, *(value(domain, n) for n in strict.planners)] for domain in strict.domains]
    return table(["domain", *strict.planners], rows)


def normalised_table(by_mode: Mapping[str, Scores]) -> list[str]:
    """Per instance and planner: the normalised score."""
    strict = by_mode["strict"]

    def value(problem: Instance, name: str) -> str:
        def of(scores: Scores) -> float | None:
            cell = scores.cells[problem].get(name)
            return None if cell is None else cell.normalised

        return _both(by_mode, of)

    return _instance_table(strict, value)


def return_table(scores: Scores) -> list[str]:
    """Per instance and planner: mean return and its 95% interval; the best in bold."""

    def value(problem: Instance, name: str) -> str:
        cell = scores.cells[problem].get(name)
        if cell is None:
            return _NONE
        text = "failed" if cell.mean is None else _mean(cell)
        return f"**{text}**" if cell.is_best else text

    return _instance_table(scores, value)


def failure_lines(scores: Scores) -> list[str]:
    """One line for each failed instance of each planner, with the first cause."""
    lines = []
    for problem, row in scores.cells.items():
        for name in scores.planners:
            if name in row and row[name].failure:
                cause = row[name].failure.replace("|", "\\|").replace("<", "\\<")
                where = f"{problem.domain_label} {problem.label}, {name}"
                lines.append(f"- {where}: {row[name].failed_trials} trials failed; {cause}")
    return lines


def lost_lines(scores: Scores) -> list[str]:
    """One line for each instance on which another planner beats the first of the run."""
    name, lines = scores.planners[0], []
    for problem, row in scores.cells.items():
        if name not in row or row[name].is_best:
            continue
        best = next((other for other, cell in row.items() if cell.is_best), None)
        if best is None:
            continue
        own = row[name]
        mean = "failed" if own.mean is None else _mean(own)
        level = ", level" if own.is_level else ""
        where = f"{problem.domain_label} {problem.label}"
        lines.append(f"- {where}: {mean}; best is {best} with {_mean(row[best])}{level}")
    return lines


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table's lines, the first column to the left and the others to the right."""
    rule = "|---|" + "---:|" * (len(heads) - 1)
    return [_line(heads), rule, *map(_line, rows)]


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _instance_table(scores: Scores, value: Callable[[Instance, str], str]) -> list[str]:
    rows = [
        [f"{problem.domain_label} {problem.label}", *(value(problem, n) for n in scores.planners)]
        for problem in scores.cells
    ]
    return table(["instance", *scores.planners], rows)


def _both(by_mode: Mapping[str, Scores], value: Callable[[Scores], float | None]) -> str:
    """The strict figure, and the lenient one if it is another."""
    found = list(dict.fromkeys(_score(value(scores)) for scores in by_mode.values()))
    return " / ".join(found)


def _score(value: float | None) -> str:
    return _NONE if value is None else f"{value:.3f}"


def _mean(cell: EntryScore) -> str:
    assert cell.mean is not None
    text = format_return(cell.mean)
    if cell.interval is None:
        return text
    return f"{text} ± {format_return((cell.interval[1] - cell.interval[0]) / 2)}"


def format_return(value: float) -> str:
    """A return with as many digits as its size deserves."""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:,.4g}"
