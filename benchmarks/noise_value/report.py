"""What the cells say: where noise pays, where it harms, and what it costs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.noise_value.compared import (
    BESIDE,
    COMPARED,
    Lead,
    Scores,
    Task,
    cases,
    compare,
    load_results,
    returns_of,
    scores_of,
)
from benchmarks.noise_value.cost import SECTIONS, read_costs
from benchmarks.noise_value.figures import draw_curves, draw_strips
from benchmarks.noise_value.methods import DEFAULT, METHODS, NONE, TWICE
from benchmarks.noise_value.rule import MARGIN, Case, constant_rule, find_rule
from benchmarks.noise_value.statistics import LEVEL, stratified_mean
from mdpo_rddl.machine.files import write_atomically

# of the return: a difference that may be significant and yet matters to nobody
_SMALL = 1e-3

Leads = Mapping[str, Mapping[Task, Lead]]


def write_report(out: Path) -> str:
    """Writes the figures and `table.md`; returns that text.

    Raises:
      InputError: if a file is not a cell's.
    """
    results, failed = load_results(out)
    scores = {task: scores_of(kept) for task, kept in results.items()}
    leads = {name: compare(results, name) for name in COMPARED if name != NONE}
    lines = [*_summary(scores, leads), "", *_sigmas(results)]
    lines += [*_small(results, leads), *_pairs(results)]
    for method in ("annealed beside", DEFAULT):
        lines += [*_rule(method, cases(results, scores, method)), ""]
    lines += [*_costs(read_costs(out)), "", *_details(results, leads)]
    if failed:
        lines += ["", f"Not measured: {'; '.join(failed)}."]
    if results:
        draw_strips(out / "strips.png", scores, [m for m in METHODS if m != NONE])
        draw_curves(out / "curves.png", results, scores)
    text = "\n".join(lines) + "\n"
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(out / "table.md", text.encode())
    return text


def _summary(scores: Mapping[Task, Scores], leads: Leads) -> list[str]:
    lines = [
        "| method | tasks | mean score (95% interval) | better | worse | better (p) | worse (p) |",
        "|---|---|---|---|---|---|---|",
    ]
    for method in COMPARED if scores else ():
        mean, low, high = stratified_mean([found[method] for found in scores.values()])
        counts = [""] * 4 if method == NONE else [str(n) for n in _counts(leads[method].values())]
        score = f"{mean:.3f} [{low:.3f}, {high:.3f}]"
        lines.append("| " + " | ".join([method, str(len(scores)), score, *counts]) + " |")
    note = "Better and worse than no noise: p < 0.05, Student's paired t-test by seed, with Holm "
    note += "over the tasks; (p): without. A score is 0 at the no-op and 1 at the best method. "
    return [*lines, "", note + _note_on_pairs()]


def _sigmas(results: Mapping[Task, Mapping[str, Any]]) -> list[str]:
    """The sigma that constant and adaptive noise have."""
    found = {kept["conditions"]["trainings"]["constant"]["sigma_max"] for kept in results.values()}
    return [f"Sigma of `constant` and `adaptive`: {sigma:g} of the range.\n" for sigma in found]


def _note_on_pairs() -> str:
    """Which second trainings begin elsewhere than the first."""
    elsewhere = [f"`{name}`" for name, lanes in METHODS.items() if len(lanes) > 1]
    same = [f"`{name}`" for name in BESIDE]
    return (
        "Beside and twice: of each seed the better one by JaxPlan's test of `none` and a second "
        f"training. That begins with other initial parameters in {', '.join(elsewhere)}, "
        f"and with the same in {', '.join(same)}, which are not to be compared with the others: "
        "they have one start less."
    )


def _counts(leads: Any) -> list[int]:
    leads = list(leads)
    found = []
    for tests in ([lead.adjusted for lead in leads], [lead.p for lead in leads]):
        pairs = [(lead.mean, p) for lead, p in zip(leads, tests, strict=True)]
        found.append(sum(mean > 0 and p < LEVEL for mean, p in pairs))
        found.append(sum(mean < 0 and p < LEVEL for mean, p in pairs))
    return found


def _small(results: Mapping[Task, Mapping[str, Any]], leads: Leads) -> list[str]:
    """How many of the significant differences are too small to matter."""
    found = []
    for method, of_method in leads.items():
        significant = {task: lead for task, lead in of_method.items() if lead.is_significant}
        small = [
            task
            for task, lead in significant.items()
            if abs(lead.mean) < _SMALL * abs(float(np.mean(returns_of(results[task], NONE))))
        ]
        if small:
            found.append(f"`{method}` {len(small)} of {len(significant)}")
    if not found:
        return []
    return [f"Of these, by less than a thousandth of the return: {', '.join(found)}.", ""]


def _pairs(results: Mapping[Task, Mapping[str, Any]]) -> list[str]:
    """What the sensitivities add to constant noise, and noise to a second update."""
    lines = []
    for method, other in (("adaptive", "constant"), (DEFAULT, TWICE)):
        better, worse, *nominal = _counts(compare(results, method, other).values())
        by_p = f"(without Holm {nominal[0]} and {nominal[1]})"
        lines.append(f"`{method}` against `{other}`: better on {better}, worse on {worse} {by_p}.")
    return [*lines, ""]


def _rule(method: str, found: Sequence[Case]) -> list[str]:
    """When noise pays, and of how many problems that the rule was not made for it is right."""
    known = [case for case in found if not case.is_held_out]
    others = [case for case in found if case.is_held_out]
    if not known or not others:
        return [f"When noise pays (`{method}`): too few tasks for a rule."]
    rule, plain = find_rule(known), constant_rule(known)
    pays = [sum(case.pays for case in part) for part in (known, others)]
    return [
        f"When noise pays (`{method}` ahead of `{TWICE}` by {MARGIN} of the score: on {pays[0]} of "
        f"{len(known)} tasks of the problems on which the rule was found, on {pays[1]} of "
        f"{len(others)} of the others): {rule}. Right on {rule.hits(known)} of "
        f"{len(known)} and, held out, {rule.hits(others)} of {len(others)}; "
        f'"{plain}" on {plain.hits(known)} and {plain.hits(others)}.'
    ]


def _costs(costs: Sequence[Mapping[str, Any]]) -> list[str]:
    """CPU time per method against no noise: median over the tasks, smallest to largest."""
    if not costs:
        return ["Costs: not measured."]
    lines = ["| method | iteration | compilation |", "|---|---|---|"]
    for method in SECTIONS:
        spent = [kept["ratio"][method] for kept in costs]
        compiled = [c["compile_seconds"][method] / c["compile_seconds"][NONE] for c in costs]
        lines.append(f"| {method} | {_spread(spent)} | {_spread(compiled)} |")
    note = f"CPU time as a multiple of that without noise, in turn in one run, {len(costs)} tasks."
    return [*lines, "", note]


def _spread(values: Sequence[float]) -> str:
    return f"{np.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"


def _details(results: Mapping[Task, Mapping[str, Any]], leads: Leads) -> list[str]:
    """A line for each task; a star marks what differs significantly from no noise."""
    heads = ["problem", "instance", "plan", "configuration", "no-op", *METHODS]
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for task, kept in results.items():
        cells = [*task, _number(float(kept["noop"]))]
        for method in METHODS:
            star = " \\*" if method != NONE and leads[method][task].is_significant else ""
            cells.append(_number(float(np.mean(returns_of(kept, method)))) + star)
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
