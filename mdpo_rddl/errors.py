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


def one_line_cause(error: Exception | str) -> str:
    """An error's message on one line of bounded length, printable and without folders."""
    text = printable(" ".join(str(error).split())) or type(error).__name__
    text = _FOLDER.sub("", text)
    return text if len(text) <= _CAUSE_LENGTH else text[: _CAUSE_LENGTH - 1] + "…"


def printable(text: object) -> str:
    """A text from a file, or a file's name, with its control characters and broken ones escaped."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in str(text))
