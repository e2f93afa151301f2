"""What a race makes of exceptions that no arm has handled."""

import contextlib
import logging
from collections.abc import Iterator

from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.problem.load import Problem

logger = logging.getLogger(__name__)


@contextlib.contextmanager
def one_line_errors(problem: Problem) -> Iterator[None]:
    """Makes what JAX or JaxPlan raise an error of the input, which names the file.

    Args:
      problem: that is planned.

    Raises:
      InputError: for any exception.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        cause = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{problem.instance_path}: cannot be planned: {cause}") from error


@contextlib.contextmanager
def incumbent_kept(judge: Judge) -> Iterator[None]:
    """Ends what fails, with a warning, where there is an incumbent to be the result.

    Args:
      judge: of the race.

    Raises:
      Exception: whatever was raised before there was an incumbent.
    """
    try:
        yield
    except Exception as error:
        if judge.incumbent is None:
            raise
        logger.warning("the best policy so far is kept: %s", one_line_cause(error))
