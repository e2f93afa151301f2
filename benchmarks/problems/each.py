"""One row for each problem of a sweep, made in a process of its own; rows that are there stay."""

import logging
from collections.abc import Callable, Iterable
from typing import Any, Protocol, TypeVar

from benchmarks.common.records import Records
from mdpo_rddl.machine.guarded import Limits, ProcessFailure, run_guarded

logger = logging.getLogger(__name__)

KEYS = ("problem", "instance")
"""What names a row."""


class OfProblem(Protocol):
    """What a row is about."""

    @property
    def problem(self) -> str:
        """Its name in rddlrepository."""

    @property
    def instance(self) -> str:
        """Its instance's name."""


_Item = TypeVar("_Item", bound=OfProblem)


def add_rows(
    records: Records,
    columns: Iterable[str],
    items: Iterable[_Item],
    check: Callable[[_Item], dict[str, Any]],
    limits: Limits,
) -> Records:
    """Adds the rows that are missing.

    Args:
      records: with `KEYS` and the columns.
      columns: after `KEYS`; a process that failed has those of its failure.
      items: one for each row.
      check: gives a row's `status`, `cause` and figures.
      limits: for each.
    """
    names = list(columns)
    for item in items:
        if records.has(item.problem, item.instance):
            continue
        for _, outcome in run_guarded(check, [item], limits):
            row = outcome._asdict() if isinstance(outcome, ProcessFailure) else outcome
            records.add(item.problem, item.instance, *(row.get(name, "") for name in names))
            logger.info("%s: %s %s", item.problem, row["status"], row["cause"])
    return records
