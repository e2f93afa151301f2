"""What the package has warned of."""

import contextlib
import logging
from collections.abc import Iterator

_LOGGER = logging.getLogger("mdpo_rddl")


class _Kept(logging.Handler):
    """Appends each warning's text to a list."""

    def __init__(self, messages: list[str]) -> None:
        super().__init__(logging.WARNING)
        self._messages = messages

    def emit(self, record: logging.LogRecord) -> None:
        """Keeps a warning once."""
        message = record.getMessage()
        if message not in self._messages:
            self._messages.append(message)


@contextlib.contextmanager
def kept_warnings() -> Iterator[list[str]]:
    """Lists the package's warnings while the block runs, whoever else hears them."""
    messages: list[str] = []
    handler = _Kept(messages)
    _LOGGER.addHandler(handler)
    try:
        yield messages
    finally:
        _LOGGER.removeHandler(handler)
