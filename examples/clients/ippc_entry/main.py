"""An entry to a planning competition: prepare an agent, play episodes, both under timers.

    python main.py DOMAIN INSTANCE [EPISODES]

The environment is not vectorized: observations and actions are by ground fluents. A timer raises
`TimedOutError` wherever the program happens to be. What it interrupts ends with what there is: a
preparation with the best policy so far, a decision with the no-op.
"""

import argparse
import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any

from pyRDDLGym import RDDLEnv
from pyRDDLGym.core.policy import BaseAgent

import mdpo_rddl as mdpo

# of the time for preparation, kept for loading and for a compilation that is late
MARGIN = 0.1


class TimedOutError(Exception):
    """The time is over."""


class Entry(BaseAgent):
    """Plans in a thread, which no signal interrupts: what comes of it is always whole."""

    def __init__(self, env: RDDLEnv, grace_seconds: float) -> None:
        """Plans nothing yet.

        Args:
          env: what will be played.
          grace_seconds: after an interrupt, for what was found until then.
        """
        self._env, self._grace_seconds = env, grace_seconds
        self._cancel = threading.Event()
        # a thread whose join was interrupted by an exception counts as ended in some Pythons
        self._is_done = threading.Event()
        self._policy: mdpo.Policy | None = None
        self._error: BaseException | None = None

    @property
    def is_ready(self) -> bool:
        """Whether there is a policy; without one the no-op is played."""
        return self._policy is not None

    def prepare(self, seconds: float) -> None:
        """Plans for that long; whatever interrupts it leaves what was found till then.

        Args:
          seconds: the time for everything.

        Raises:
          InputError: if the problem cannot be planned.
        """
        thread = threading.Thread(target=self._plan, args=(seconds * (1 - MARGIN),))
        thread.start()
        try:
            self._is_done.wait()
        finally:
            # an exception that came meanwhile goes on once this is done
            self._cancel.set()
            self._is_done.wait(self._grace_seconds)
        if self._error is not None:
            raise self._error

    def _plan(self, seconds: float) -> None:
        try:
            self._policy = mdpo.plan(
                self._env, seconds=seconds, progress=False, cancel=self._cancel
            )
        except BaseException as error:
            self._error = error
        finally:
            self._is_done.set()

    def reset(self) -> None:
        """Begins an episode."""
        if self._policy is not None:
            self._policy.reset()

    def sample_action(self, state: Any = None) -> dict[str, Any]:
        """The action for a state by ground fluents."""
        return {} if self._policy is None else self._policy.sample_action(state)


@contextlib.contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raises `TimedOutError` in the block once the time is over."""

    def raise_timed_out(number: int, frame: Any) -> None:
        raise TimedOutError

    before = signal.signal(signal.SIGALRM, raise_timed_out)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def play(env: RDDLEnv, agent: BaseAgent, seed: int, decision_seconds: float) -> float:
    """The discounted return of an episode; a decision that is late is the no-op."""
    state, _ = env.reset(seed=seed)
    agent.reset()
    total, discount, is_done = 0.0, 1.0, False
    while not is_done:
        action: dict[str, Any] = {}
        with contextlib.suppress(TimedOutError), time_limit(decision_seconds):
            action = agent.sample_action(state)
        state, reward, terminated, truncated, _ = env.step(action)
        total += discount * reward
        discount *= env.discount
        is_done = terminated or truncated
    return total


def main() -> None:
    """Prepares and plays."""
    parser = argparse.ArgumentParser(description="An entry to a planning competition.")
    parser.add_argument("domain", help="the domain's file")
    parser.add_argument("instance", help="the instance's file")
    parser.add_argument("episodes", nargs="?", type=int, default=5)
    parser.add_argument("--prepare", type=float, default=60.0, metavar="SECONDS")
    parser.add_argument("--timer", type=float, metavar="SECONDS", help="of the preparation")
    parser.add_argument("--grace", type=float, default=20.0, metavar="SECONDS")
    parser.add_argument("--decide", type=float, default=1.0, metavar="SECONDS")
    options = parser.parse_args()

    env = RDDLEnv(options.domain, options.instance, enforce_action_constraints=True)
    agent = Entry(env, options.grace)
    try:
        with time_limit(options.timer or options.prepare):
            agent.prepare(options.prepare)
    except TimedOutError:
        print("preparation was interrupted")
    print("policy: found" if agent.is_ready else "policy: none, the no-op is played")
    for episode in range(options.episodes):
        total = play(env, agent, episode, options.decide)
        print(f"episode {episode}: {total:.3f}")


if __name__ == "__main__":
    main()
