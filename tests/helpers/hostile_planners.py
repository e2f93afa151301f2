"""Planners for the toy problem that do what no planner should, in the second trial."""

import os
import signal
import sys
import tempfile
import time
from pathlib import Path

from helpers.hostile_work import line
from helpers.toy_contest import Steady


class Hostile(Steady):
    """Does something in the second trial, and plays on if it can."""

    def push(self, step, state, rng):
        if self.trial == 1 and step == 0:
            self.strike()
        return super().push(step, state, rng)

    def strike(self):
        raise NotImplementedError


class Crashing(Hostile):
    """Breaks down where Python cannot help."""

    def strike(self):
        os.kill(os.getpid(), signal.SIGSEGV)


class Leaving(Hostile):
    """Ends the process, as a script does."""

    def strike(self):
        sys.exit(0)


class Hanging(Hostile):
    """Listens to no signal."""

    def strike(self):
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGALRM):
            signal.signal(number, signal.SIG_IGN)
        time.sleep(600)


class Leaking(Hostile):
    """Takes ever more memory."""

    def strike(self):
        hoard = []
        while True:
            hoard.append(bytearray(b"x" * 2**26))
            time.sleep(0.002)


class Printing(Hostile):
    """Prints 64 MB."""

    def strike(self):
        for _ in range(2**10):
            sys.stdout.write("x" * 2**16 + "\n")
        sys.stdout.flush()


class Forking(Hostile):
    """Is two planners from then on, and has left another three to themselves."""

    def strike(self):
        for _ in range(3):
            if os.fork() == 0:
                os.setsid()
                time.sleep(600)
        os.fork()


class Garbling(Hostile):
    """Finds the line by which results are sent, and sends its own."""

    def strike(self):
        os.write(line(), b'[5, {"trial": 1, "status": "ok", "total": "a lot"}]\n')


class Repeating(Hostile):
    """Sends answers once more that it has given before."""

    def strike(self):
        os.write(line(), b'[1, {}]\n[2, {"trial": 0, "status": "ok", "total": 99.0}]\n')


class CuttingOff(Hostile):
    """Begins a message, and never ends it."""

    def strike(self):
        os.write(line(), b'[3, {"trial": 1, "sta')
        time.sleep(600)


class Lagging(Hostile):
    """Answers once its time is over."""

    def strike(self):
        time.sleep(4)


class Filling(Hostile):
    """Writes a file without end."""

    def strike(self):
        with tempfile.TemporaryFile() as file:
            file.seek(2**31 - 2**20)
            while True:
                file.write(b"x" * 2**16)


class Hoarding(Hostile):
    """Fills the disk with files that it leaves, where it was told to keep its temporary ones."""

    def strike(self):
        folder = Path(tempfile.gettempdir())
        for number in range(1000):
            (folder / f"{number}").write_bytes(os.urandom(2**20))
