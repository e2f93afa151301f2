"""A child process: started, asked, answered, and ended with everything that it has started.

All child processes of this package are these. What is asked and answered is JSON.
"""

import math
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from mdpo_rddl.machine.messages import Correspondence, GarbledError, Messages
from mdpo_rddl.machine.process_tree import adopt_orphans, end_started, end_tree

_POLL_SECONDS = 0.1
_WATCH_SECONDS = 0.5
# between the end of what a process sends and its own end
_EXIT_SECONDS = 10.0
# of what it prints: the most on the disk (as often as we look), and the end that is kept
_MOST_LOG, _LOG_END = 2**24, 2**12
_CACHE_FOLDER = "JAX_COMPILATION_CACHE_DIR"
_CACHE_SECONDS = "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"


class ChildEndedError(Exception):
    """The process ended without an answer; the message says how, in one line."""


class Child:
    """A process of this Python; a context manager that ends it.

    It leads a session of its own, so an interrupt at the terminal does not reach it. It ends
    with this process, however that ends. It keeps compiled programs where this process does,
    and none if this process keeps none.

    Attributes:
      pid: its number.
      folder: for files to hand over, and for its temporary files; removed with the process.
    """

    def __init__(self, serve: Callable[[Messages], None], on_cpu: bool = False) -> None:
        """Starts the process.

        Args:
          serve: what it does: a function at the top of a module that can be imported. What it
            prints goes to a log, whose last line is told if it fails.
          on_cpu: whether JAX must leave other devices alone.

        Raises:
          OSError: if no process can be started.
        """
        self._temporary = tempfile.TemporaryDirectory(
            prefix="mdpo-child-", ignore_cleanup_errors=True
        )
        self.folder = Path(self._temporary.name)
        # stays open: the folder is the child's to clear
        self._log = (self.folder / "log").open("a+b", buffering=0)
        self._said = b""
        ours, theirs = socket.socketpair()
        self._line = Correspondence(ours)
        command = (
            f"from {__name__} import begin, run; "
            f"messages = begin({theirs.fileno()}, {os.getpid()}); "
            f"from {serve.__module__} import {serve.__qualname__} as serve; "
            "run(serve, messages)"
        )
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", command],
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
                env={**_environment(on_cpu), "TMPDIR": str(self.folder)},
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        self.pid = self._process.pid

    def __enter__(self) -> "Child":
        return self

    def __exit__(self, *error: object) -> None:
        self.end()

    def ask(self, message: Any) -> None:
        """Sends what JSON can hold.

        Raises:
          ChildEndedError: if the process has ended.
        """
        try:
            self._line.send(message)
        except OSError as error:
            raise ChildEndedError(self._last_words()) from error

    def answer(self, seconds: float = math.inf) -> Any:
        """Waits for the next message.

        Args:
          seconds: how long to wait at most.

        Raises:
          ChildEndedError: if the process ended before, or sent what is no message.
          TimeoutError: if there is no message in time.
        """
        until = time.monotonic() + seconds
        try:
            while True:
                left = until - time.monotonic()
                try:
                    return self._line.receive(min(_POLL_SECONDS, max(0.0, left)))
                except TimeoutError:
                    if left <= 0.0:
                        raise
                self._cut_log()
                # somebody whom it has started may hold its end of the line open
                if self._exit() is not None:
                    return self._last_message()
        except TimeoutError:
            raise
        except GarbledError as error:
            raise ChildEndedError("it sent what is no message") from error
        except (EOFError, OSError) as error:
            raise ChildEndedError(self._last_words()) from error

    def _last_message(self) -> Any:
        """What the process has sent before its end; raises EOFError if that is nothing."""
        try:
            return self._line.receive(_POLL_SECONDS)
        except TimeoutError as error:
            raise EOFError from error

    def _cut_log(self) -> None:
        """Keeps the end alone of what a process prints without end."""
        if os.fstat(self._log.fileno()).st_size > _MOST_LOG:
            self._said = self._log_end()
            self._log.truncate(0)

    def _log_end(self) -> bytes:
        self._log.seek(max(0, self._log.seek(0, os.SEEK_END) - _LOG_END))
        return (self._said + self._log.read(_LOG_END))[-_LOG_END:]

    def end(self) -> None:
        """Kills the process and everything that it has started, and removes the folder."""
        if self._process.returncode is None:
            end_tree(self.pid)
            self._process.wait()
        self._line.close()
        self._log.close()
        self._temporary.cleanup()

    def _exit(self) -> Any:
        """How the process ended; None if it has not. Its number stays its own till `end`."""
        return os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)

    def _last_words(self) -> str:
        until = time.monotonic() + _EXIT_SECONDS
        while (ended := self._exit()) is None:
            if time.monotonic() > until:
                return "it sends no more"
            time.sleep(0.01)
        if ended.si_code == os.CLD_EXITED:
            how = f"exit status {ended.si_status}"
        else:
            how = f"killed by {_signal_name(ended.si_status)}"
        said = self._log_end().decode(errors="replace").split("\n")
        lines = [" ".join(line.split()) for line in said if line.strip()]
        return f"{how}: {lines[-1]:.300}" if lines else how


def _signal_name(number: int) -> str:
    """Of a signal; most real-time ones have none."""
    return signal.Signals(number).name if number in set(signal.Signals) else f"signal {number}"


def begin(descriptor: int, parent: int) -> Messages:
    """What a child process does first.

    Args:
      descriptor: of its end of the line.
      parent: the process to end with.
    """
    adopt_orphans()
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    # the parent ends us. A cluster that wants the machine back signals all processes of a job;
    # what we start stays killable
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR2):
        signal.signal(number, _ignore)
        os.register_at_fork(after_in_child=partial(signal.signal, number, signal.SIG_DFL))
    os.set_inheritable(descriptor, False)
    return Messages(socket.socket(fileno=descriptor))


def run(serve: Callable[[Messages], None], messages: Messages) -> None:
    """What a child process does then; what it has started ends with it."""
    try:
        serve(messages)
    finally:
        messages.close()
        end_started(os.getpid())


def _end_with(parent: int) -> None:
    """Ends this process and all that it has started once its parent is gone."""
    while os.getppid() == parent:
        time.sleep(_WATCH_SECONDS)
    end_tree(os.getpid())


def _ignore(number: int, frame: Any) -> None:
    """Leaves a signal to the parent; unlike `SIG_IGN`, no program that we start inherits it."""


def _environment(on_cpu: bool) -> dict[str, str]:
    """The variables of a child: where its modules are, its devices, its cache."""
    paths = [path or os.getcwd() for path in sys.path]
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    if on_cpu:
        variables["JAX_PLATFORMS"] = "cpu"
    jax: Any = sys.modules.get("jax")
    if jax is not None:  # else the variables say what this process does
        values = jax.config.values
        folder = values["jax_compilation_cache_dir"]
        if folder is None or not values["jax_enable_compilation_cache"]:
            variables.pop(_CACHE_FOLDER, None)
        else:
            variables[_CACHE_FOLDER] = str(folder)
            variables[_CACHE_SECONDS] = str(values["jax_persistent_cache_min_compile_time_secs"])
    return variables
