"""Writes the page into a run folder, or one that compares several."""

import logging
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from mdpo_rddl.errors import InputError, one_line_cause, printable
from mdpo_rddl.machine.files import write_atomically
from mdpo_rddl.session.report.page.record import read_run
from mdpo_rddl.session.report.page.render import comparison_page, run_page
from mdpo_rddl.session.report.run_folder import PAGE, RunFolder

logger = logging.getLogger(__name__)


def add_page(folder: RunFolder) -> None:
    """Writes the page of a run under construction; a mistake in it costs the run nothing."""
    try:
        run = read_run(folder.staging)
        name = printable(folder.target.name)
        write_atomically(folder.staging / PAGE, _encoded(lambda: run_page(run, name)))
    except Exception as error:
        logger.warning("no %s: %s", PAGE, _told(error))


def write_page(folder: Path, out: Path | None = None) -> Path:
    """Writes the page of a run, from what is in its folder.

    Args:
      folder: the run folder.
      out: where; `report.html` in the folder if None.

    Returns:
      The page's path.

    Raises:
      InputError: if the folder is no run folder or damaged, or the page cannot be written.
    """
    page = out or folder / PAGE
    write_atomically(page, _made([folder], lambda: run_page(read_run(folder))))
    return page


def write_comparison(folders: Sequence[Path], out: Path) -> Path:
    """Writes one page that compares several runs with the first one.

    Returns:
      The page's path.

    Raises:
      InputError: as `write_page`, or if a folder is named twice.
    """
    if len({folder.resolve() for folder in folders}) < len(folders):
        raise InputError(f"{folders[0]}: compared with itself: name each run folder once")

    def compared() -> str:
        runs = [read_run(folder) for folder in folders]
        if len({run.name for run in runs}) < len(runs):
            runs = [
                replace(run, name=printable(path)) for run, path in zip(runs, folders, strict=True)
            ]
        return comparison_page(runs)

    write_atomically(out, _made(folders, compared))
    return out


def _made(folders: Sequence[Path], make: Callable[[], str]) -> bytes:
    """A page of folders that anybody may have filled, as a file holds it.

    Raises:
      InputError: naming the folders, for whatever cannot be shown.
    """
    try:
        return _encoded(make)
    except InputError:
        raise
    except Exception as error:
        names = ", ".join(map(str, folders))
        raise InputError(f"{names}: no page can be made of it: {_told(error)}") from error


def _encoded(make: Callable[[], str]) -> bytes:
    """A page as a file holds it, made without a word."""
    with warnings.catch_warnings():
        # of numbers whose squares are too large, and characters that the pictures' font lacks
        warnings.simplefilter("ignore")
        return make().encode("utf-8", "replace")


def _told(error: Exception) -> str:
    """An error on one line, with the name of its class."""
    return f"{type(error).__name__}: {one_line_cause(error)}"
