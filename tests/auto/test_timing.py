"""Programs that know how long they take."""

from mdpo_rddl.auto.timing import Timed


class Watch:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_the_first_call_compiles():
    watch = Watch()

    def work(seconds: float) -> str:
        watch.now += seconds
        return f"{seconds:g} s"

    timed = Timed(work, watch)
    assert (timed.calls, timed.compile_seconds) == (0, 0.0)
    assert timed(5.0) == "5 s"
    assert (timed.seconds, timed.compile_seconds) == (5.0, 5.0)
    timed(1.0)
    timed(seconds=2.0)
    assert (timed.calls, timed.seconds, timed.compile_seconds) == (3, 2.0, 3.0)
    timed(6.0)  # a busy machine is no negative compilation
    assert timed.compile_seconds == 0.0
