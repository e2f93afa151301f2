"""A run's report: `scores.md`, `scores.json` and two pictures."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc.conditions import load_conditions
from mdpo_rddl.ipc.figures import draw_domains, draw_profiles
from mdpo_rddl.ipc.names import JAXPLAN, PLANNER_NAMES
from mdpo_rddl.ipc.published import published_table
from mdpo_rddl.ipc.results import EntryResult, load_results
from mdpo_rddl.ipc.score import MODES, Scores, score
from mdpo_rddl.ipc.tables import (
    domain_table,
    failure_lines,
    lost_lines,
    normalised_table,
    overall_table,
    return_table,
)
from mdpo_rddl.machine.files import MOST_BYTES, read_bounded, write_atomically

MARKDOWN, JSON = "scores.md", "scores.json"
REMARKS = "remarks.md"
"""What somebody has to say about the run, in its folder; the report includes it."""
DOMAINS_PICTURE, PROFILES_PICTURE = "domains.png", "profiles.png"


def write_report(root: Path) -> str:
    """Scores a run as far as it has got and writes the report into its folder.

    Returns:
      The report in Markdown.

    Raises:
      InputError: if the folder holds no run or cannot be written.
    """
    conditions, results = load_conditions(root), load_results(root)
    if not any(result.is_complete for result in results):
        raise InputError(f"{root}: no entry has been played to its end yet")
    planners = ordered_planners(results)
    # in a strict run nobody knows how a trial would have gone on
    modes = MODES if conditions["lenient"] else MODES[:1]
    by_mode = {mode: score(results, mode, planners) for mode in modes}
    text = markdown(conditions, results, by_mode, _remarks(root))
    write_atomically(root / MARKDOWN, text.encode())
    values = json.dumps(_values(conditions, by_mode), indent=1, allow_nan=False)
    write_atomically(root / JSON, values.encode() + b"\n")
    shown = by_mode["strict"]
    write_atomically(root / DOMAINS_PICTURE, draw_domains(shown))
    write_atomically(root / PROFILES_PICTURE, draw_profiles(shown))
    return text


def ordered_planners(results: Sequence[EntryResult]) -> list[str]:
    """The planners of a run: somebody else's first, then the known ones in their order."""
    found = {result.entry.planner for result in results}
    own = [name for name in PLANNER_NAMES if name in found]
    return sorted(found.difference(own)) + own


def markdown(
    conditions: Mapping[str, Any],
    results: Sequence[EntryResult],
    by_mode: Mapping[str, Scores],
    remarks: str = "",
) -> str:
    """The report's text.

    Args:
      conditions: of the run.
      results: all its entries.
      by_mode: its scores in one or both of `MODES`.
      remarks: Markdown that goes under a heading of its own.
    """
    strict = by_mode["strict"]
    unfinished = sum(not result.is_complete for result in results)
    lines = ["# Scores", "", _terms(conditions), ""]
    if unfinished:
        lines += [f"Entries that are not finished, and not scored: {unfinished}.", ""]
    sections = {
        "Overall": overall_table(by_mode),
        "Domains, normalised": domain_table(by_mode),
        "Instances, normalised": normalised_table(by_mode),
        "Instances, mean return": return_table(strict),
        "Failures": failure_lines(strict),
        f"Where {strict.planners[0]} is not best": lost_lines(strict),
        "Remarks": remarks.strip().splitlines(),
        "Published scores, of other runs": published_table(strict),
    }
    for heading, body in sections.items():
        if body:
            lines += [f"## {heading}", "", *body, ""]
    lines += [
        f"![Scores of the domains]({DOMAINS_PICTURE})",
        "",
        f"![Performance profiles]({PROFILES_PICTURE})",
    ]
    return "\n".join(lines) + "\n"


def _remarks(root: Path) -> str:
    path = root / REMARKS
    try:
        return read_bounded(path, MOST_BYTES, root).decode() if path.exists() else ""
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _terms(conditions: Mapping[str, Any]) -> str:
    text = (
        f"{conditions['trials']} trials an instance, {conditions['plan_seconds']:g} s to prepare "
        f"and {conditions['trial_seconds']:g} s a trial, at most {conditions['memory_gb']:g} GB, "
        f"{_counted(conditions['cores'], 'core')}, seed {conditions['seed']}. A normalised score "
        "is 0 at the better one of noop and random and 1 at the best planner of this run; a failed "
        "trial makes it 0, and an instance on which noop and random fail is left out. "
    )
    if conditions["lenient"]:
        return text + (
            "Trials went on after an action that broke a precondition of the domain. Such an "
            "action fails the trial in the strict score. In the lenient one, the competition's, "
            "it does not. Where there are two figures, the strict one comes first."
        )
    return text + "An action that breaks a precondition of the domain fails the trial."


def _values(conditions: Mapping[str, Any], by_mode: Mapping[str, Scores]) -> dict[str, Any]:
    return {
        "conditions": conditions,
        **{
            mode: {
                "overall": scores.overall,
                "jaxplan_better_of_two": scores.better_of(JAXPLAN),
                "domains": scores.domains,
                "best": {name: scores.count(name, best_only=True) for name in scores.planners},
                "best_or_level": {name: scores.count(name) for name in scores.planners},
                "instances": [
                    {
                        "domain": problem.domain_label,
                        "instance": problem.label,
                        "planners": {name: asdict(cell) for name, cell in row.items()},
                    }
                    for problem, row in scores.cells.items()
                ],
            }
            for mode, scores in by_mode.items()
        },
    }
