"""The log on the command line."""

import copy
import logging

from mdpo_rddl.errors import printable


class _Escaped(logging.Formatter):
    """Messages without control characters: they may name what strangers' files hold."""

    def format(self, record: logging.LogRecord) -> str:
        """The text of a record; its traceback is left as it is."""
        shown = copy.copy(record)
        shown.msg = "\n".join(map(printable, record.getMessage().splitlines()))
        shown.args = None
        return super().format(shown)


def show_log(level: int, line: str) -> None:
    """Shows the log on standard error, unless somebody shows it already.

    Args:
      level: the lowest that is shown.
      line: of one record, as `logging.Formatter` takes it.
    """
    handler = logging.StreamHandler()
    handler.setFormatter(_Escaped(line))
    logging.basicConfig(level=level, handlers=[handler])
