"""How every command ends: bad input and what the system refuses are one line and a status.

Errors of the package keep their traceback.
"""

import contextlib
import errno
import functools
import io
import os
import select
import signal
import sys
from collections.abc import Callable, Sequence

from mdpo_rddl.cli.termination import exit_status, how_it_ended
from mdpo_rddl.errors import InputError, printable
from mdpo_rddl.machine.background import is_at_work

BROKEN_PIPE = 128 + signal.SIGPIPE
"""The exit status where nobody reads the output any more."""

# without a file's name they are those of standard output: other writers name their file
_OF_WRITING = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)

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
            _make_streams_usable()
            try:
                try:
                    return main(arguments)
                finally:
                    _flush()  # else it fails at exit, with a status of Python's
            except InputError as error:
                return _refused(name, " ".join(str(error).split()))
            except OSError as error:
                return _refused_by_the_system(name, error)
            except KeyboardInterrupt as stop:
                _say(f"{name}: {how_it_ended(stop)}")
                return exit_status(stop)

        return wrapped

    return wrap


def without_waiting(status: int) -> int:
    """Ends the process if something is still being compiled; else that is left to the caller.

    Python would wait for it, and nothing interrupts a compilation. From here on a signal ends the
    process at once: what libraries do at the end of Python need not be told of.

    Args:
      status: of the command, which has written and printed all that it has to.

    Returns:
      The status.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    if is_at_work():
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError, AttributeError):
                stream.flush()
        os._exit(status)
    return status


def _make_streams_usable() -> None:
    """Gives the process the streams that it was started without, and each any character.

    A letter that the terminal's encoding does not have is no reason to end a run.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115, open until the end
        if isinstance(stream := getattr(sys, name), io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _flush() -> None:
    if sys.stdout is not None and not sys.stdout.closed:
        sys.stdout.flush()


def _refused_by_the_system(name: str, error: OSError) -> int:
    """The status, after a line that says what was refused.

    Raises:
      OSError: that error, if it is not the system's.
    """
    if error.filename is not None:
        return _refused(name, f"{os.fsdecode(error.filename)}: {error.strerror or error}")
    if isinstance(error, BrokenPipeError) and _reader_is_gone():
        _drop_output()
        return BROKEN_PIPE
    if error.errno is None:
        raise error
    if error.errno in _OF_WRITING:
        _drop_output()
    of = "the output: " if error.errno in _OF_WRITING else ""
    return _refused(name, f"{of}{error.strerror}")


def _refused(name: str, cause: str) -> int:
    # texts and names of strangers' files may hold what a terminal obeys
    _say(f"{name}: error: {printable(cause)}")
    return 2


def _say(line: str) -> None:
    with contextlib.suppress(OSError):
        print(line, file=sys.stderr)


def _reader_is_gone() -> bool:
    """Whether the output is a pipe that nobody reads."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        output = select.poll()
        output.register(sys.stdout.fileno(), 0)
        return any(event & select.POLLERR for _, event in output.poll(0))
    return False


def _drop_output() -> None:
    """Sends what is left of the output nowhere: writing it at exit would fail once more."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
