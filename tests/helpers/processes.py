"""What child processes do in tests, and whether they are still there."""

import os
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

from mdpo_rddl.machine.child import Messages


def is_alive(pid: int) -> bool:
    """Whether a process runs; one that only has not been waited for does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def all_gone(pids: Iterable[int], seconds: float) -> bool:
    """Whether all these processes end within a time."""
    until = time.monotonic() + seconds
    while any(map(is_alive, pids)):
        if time.monotonic() > until:
            return False
        time.sleep(0.05)
    return True


def echo(messages: Messages) -> None:
    """Sends everything back, with its own number."""
    os.write(1, b"noise on standard output\n")
    while True:
        messages.send([messages.receive(), os.getpid()])


def parent_of_two(messages: Messages) -> None:
    """Starts a process in its own session and one in another, and tells their numbers."""
    started = [subprocess.Popen(["sleep", "600"], start_new_session=new) for new in (False, True)]
    messages.send([process.pid for process in started])
    messages.receive()


_ORPHAN = """
import os, sys, time
if os.fork():
    os._exit(0)
os.setsid()
if os.fork():
    os._exit(0)
print(os.getpid(), flush=True)
os.close(1)
time.sleep(600)
"""


def parent_of_an_orphan(messages: Messages) -> None:
    """Starts a process that leaves its session and loses its parents, and tells its number."""
    command = [sys.executable, "-c", _ORPHAN]
    messages.send([int(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)])
    messages.receive()


def leaves_by_itself(messages: Messages) -> None:
    """Ends before it answers, with a process that still holds its end of the line."""
    os.set_inheritable(messages.line.fileno(), True)
    process = subprocess.Popen(["sleep", "600"], close_fds=False)
    messages.send(process.pid)
    sys.stderr.write("a check failed:\n  no such kernel\n")
    sys.stderr.flush()
    os._exit(3)


def compiles(messages: Messages) -> None:
    """Compiles something that takes a while to compile."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    messages.send(float(jax.jit(lambda x: jnp.linalg.inv(x).sum())(jnp.eye(4))))
