"""How every command ends: with a status and at most one line, never with a traceback of the user's.

An error of ours keeps its traceback.
"""

import contextlib
import functools
import os
import signal
import sys
from collections.abc import Callable, Sequence

from mdpo_rddl.cli.termination import exit_status, how_it_ended
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.background import is_at_work

BROKEN_PIPE = 128 + signal.SIGPIPE
"""The exit status where nobody reads the output any more."""

Main = Callable[..., int]


def ending_in_order(name: str) -> Callable[[Main], Main]:
    """Wraps the main function of a command.

    Bad input, and what the system refuses (a full disk behind standard output, a name that is too
    long, a folder that may not be read), become one line and status 2; an interrupt becomes 130;
    a pipe that nobody reads ends the command silently.

    Args:
      name: of the command.
    """

    def wrap(main: Main) -> Main:
        @functools.wraps(main)
        def wrapped(arguments: Sequence[str] | None = None) -> int:
            try:
                try:
                    return main(arguments)
                finally:
                    _flush()  # else it fails at exit, with a status of Python's
            except InputError as error:
                return _refused(name, " ".join(str(error).split()))
            except BrokenPipeError:
                _drop_output()
                return BROKEN_PIPE
            except OSError as error:
                if error.filename is None:
                    _drop_output()
                return _refused(name, _cause(error))
            except KeyboardInterrupt as stop:
                _say(f"{name}: {how_it_ended(stop)}")
                return exit_status(stop)

        return wrapped

    return wrap


def without_waiting(status: int) -> int:
    """Ends the process if something is still being compiled; else that is left to the caller.

    Python would wait for it, and nothing interrupts a compilation.

    Args:
      status: of the command, which has written and printed all that it has to.

    Returns:
      The status.
    """
    if is_at_work():
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError, AttributeError):
                stream.flush()
        os._exit(status)
    return status


def _flush() -> None:
    if sys.stdout is not None and not sys.stdout.closed:
        sys.stdout.flush()


def _refused(name: str, cause: str) -> int:
    _say(f"{name}: error: {cause}")
    return 2


def _say(line: str) -> None:
    with contextlib.suppress(OSError):
        print(line, file=sys.stderr)


def _cause(error: OSError) -> str:
    where = "the output" if error.filename is None else os.fsdecode(error.filename)
    return f"{where}: {error.strerror or error}"


def _drop_output() -> None:
    """Sends what is left of the output nowhere: writing it at exit would fail once more."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
