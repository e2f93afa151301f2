"""The exceptions that all rooms share, and errors told in one line."""

import re

_CAUSE_LENGTH = 240
# a folder is this machine's business, the file's name is not
_FOLDER = re.compile(r"(?<![\w.])(?:/[\w.@+-]+)+/")


class InputError(Exception):
    """Bad input: a file, name, option or number that the user can correct.

    The message is one line that names what is wrong and where (the file and, where it
    is known, the line). The command line prints it and ends with status 2.
    """


class Cancelled(BaseException):
    """Work was asked to end before its time.

    Like `KeyboardInterrupt` it is no `Exception`: nobody handles it as a failure of the work.
    """


_HEARD = "heard"
_MOST_CAUSES = 100


def note_heard(stop: BaseException) -> None:
    """Notes at an interrupt that its catcher ends the work in order: it need not come again."""
    if not is_heard(stop):
        stop.add_note(_HEARD)


def is_heard(stop: BaseException) -> bool:
    """Whether whoever has caught an interrupt ends the work in order."""
    return _HEARD in getattr(stop, "__notes__", ())


def interrupt_behind(error: BaseException | None) -> KeyboardInterrupt | None:
    """The interrupt that an error was made of, unless that was heard.

    Libraries have handlers of any exception, which raise one of their own or go on.
    """
    for _ in range(_MOST_CAUSES):
        if isinstance(error, KeyboardInterrupt):
            return None if is_heard(error) else error
        if error is None:
            break
        error = error.__cause__ or error.__context__
    return None


def one_line_cause(error: Exception | str) -> str:
    """An error's message on one line of bounded length, printable and without folders."""
    text = printable(" ".join(str(error).split())) or type(error).__name__
    text = _FOLDER.sub("", text)
    return text if len(text) <= _CAUSE_LENGTH else text[: _CAUSE_LENGTH - 1] + "…"


def printable(text: object) -> str:
    """A text from a file, or a file's name, with its control characters and broken ones escaped."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in str(text))
