"""Processes of this Python that end with the one that started them."""

import os
import signal
import subprocess
import sys
import time


def start_python(command: str) -> "subprocess.Popen[bytes]":
    """Starts a process of this Python on the CPU, with pipes to and from it.

    Args:
      command: one line of Python.
    """
    paths = os.pathsep.join(path for path in sys.path if path)
    return subprocess.Popen(
        [sys.executable, "-P", "-c", command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": paths, "JAX_PLATFORMS": "cpu"},
        start_new_session=True,  # an interrupt is for the first process
    )


def end_with(parent: int) -> None:
    """Ends the process and its children once its parent is gone, as a killed one cannot."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os.killpg(0, signal.SIGKILL)
