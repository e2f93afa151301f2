"""The line between a process and its child: a message of JSON to a line of text.

What comes from a child is not trusted: it may be cut, garbled, endless or late.
"""

import base64
import json
import os
import pickle
import select
import socket
import time
from typing import Any

MOST_BYTES = 2**26
"""Of a message."""

# a child that takes no messages, whose line is full
_SEND_SECONDS = 60.0
_CHUNK = 2**16


class GarbledError(Exception):
    """What has come is no message."""


class Messages:
    """The child's end of the line: whatever JSON can hold, in this process alone."""

    def __init__(self, line: socket.socket) -> None:
        self.line = line
        self._file = line.makefile("rb")
        self._owner = os.getpid()

    def send(self, message: Any) -> None:
        """Sends a message.

        Raises:
          OSError: if nobody is at the other end.
        """
        self._end_if_forked()
        self.line.sendall(_encoded(message))

    def receive(self) -> Any:
        """Waits for a message.

        Raises:
          EOFError, OSError: if nobody is at the other end.
        """
        self._end_if_forked()
        text = self._file.readline()
        if not text.endswith(b"\n"):
            raise EOFError
        return json.loads(text)

    def close(self) -> None:
        """Ends the line."""
        self._file.close()
        self.line.close()

    def _end_if_forked(self) -> None:
        """Ends a process that the work has forked, and that comes back as if it were this one."""
        if os.getpid() != self._owner:
            os._exit(1)


class Correspondence:
    """The parent's end of the line."""

    def __init__(self, line: socket.socket) -> None:
        self._line, self._received, self._searched = line, bytearray(), 0
        line.settimeout(_SEND_SECONDS)
        self._poll = select.poll()
        self._poll.register(line, select.POLLIN)

    def send(self, message: Any) -> None:
        """Sends a message.

        Raises:
          OSError: if nobody is at the other end, or nobody reads there.
        """
        self._line.sendall(_encoded(message))

    def receive(self, seconds: float) -> Any:
        """The next message, whole.

        Args:
          seconds: how long to wait at most; what has come of a message is kept for the next time.

        Raises:
          TimeoutError: if there is none in time.
          EOFError, OSError: if nobody is at the other end.
          GarbledError: if what has come is none, or longer than `MOST_BYTES`.
        """
        until, left = time.monotonic() + seconds, seconds
        while (end := self._received.find(b"\n", self._searched)) < 0:
            self._searched = len(self._received)
            if self._searched > MOST_BYTES:
                raise GarbledError
            # bytes that come one by one keep nobody waiting either
            if left < 0.0 or not self._poll.poll(1000 * left):
                raise TimeoutError
            chunk = self._line.recv(_CHUNK)
            if not chunk:
                raise EOFError
            self._received += chunk
            left = until - time.monotonic()
        text = bytes(self._received[:end])
        del self._received[: end + 1]
        self._searched = 0
        try:
            return json.loads(text)
        except (ValueError, RecursionError) as error:
            raise GarbledError from error

    def close(self) -> None:
        """Ends the line."""
        self._line.close()


def packed(value: Any) -> str:
    """What JSON cannot hold, as a part of a message between a process and its own child."""
    return base64.b64encode(pickle.dumps(value)).decode()


def unpacked(text: str) -> Any:
    """The same again; never of what comes from a child that runs what others wrote."""
    return pickle.loads(base64.b64decode(text))


def _encoded(message: Any) -> bytes:
    return json.dumps(message).encode() + b"\n"
