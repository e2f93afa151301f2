"""Work that sends what it should not over the line to its parent; light to import."""

import os
import stat
import threading
import time
from typing import Any


def line() -> int:
    """The descriptor of this process's end of the line, as anybody in it can find it."""
    (found,) = (n for n in range(3, 64) if _is_socket(n))
    return found


def _is_socket(number: int) -> bool:
    try:
        return stat.S_ISSOCK(os.fstat(number).st_mode)
    except OSError:
        return False


def _trickle() -> None:
    while True:
        os.write(line(), b"1")
        time.sleep(0.01)


SENT = {
    "repeated": b'[1, {}]\n[2, {"count": 99}]\n',
    "cut": b'[2, {"coun',
    "garbled": b"\xff\x00 }{\n",
    "nested": b"[" * 100_000 + b"\n",
    "early": b'[77, {"count": 99}]\n',
    "another": b'"count"\n',
}


def _trickling() -> None:
    threading.Thread(target=_trickle, daemon=True).start()
    time.sleep(600)


def _printing() -> None:
    for _ in range(600):
        os.write(1, b"x" * 2**16 + b"\n")
    time.sleep(0.5)


def _cleaning() -> None:
    folder = os.environ["TMPDIR"]
    for name in os.listdir(folder):
        os.unlink(os.path.join(folder, name))
    os._exit(5)


def _large_file() -> None:
    with open(os.path.join(os.environ["TMPDIR"], "large"), "wb") as file:
        file.seek(2**31)
        file.write(b"x")


def _many() -> None:
    for _ in range(30):
        if os.fork() == 0:
            break
    time.sleep(600)


DOING = {
    "cut": lambda: time.sleep(600),
    "trickle": _trickling,
    "forked": os.fork,  # both go on
    "printing": _printing,
    "cleaning": _cleaning,
    "large file": _large_file,
    "many": _many,
}


class Sending:
    """Counts its calls, after it has sent and done what the item says."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, item: str) -> dict[str, Any]:
        self.count += 1
        if item in SENT:
            os.write(line(), SENT[item])
        if item in DOING:
            DOING[item]()
        return {"count": self.count, "folder": os.environ["TMPDIR"]}
