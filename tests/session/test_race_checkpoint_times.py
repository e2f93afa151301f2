"""When a race writes its checkpoints, and when not."""

from helpers.race_checkpoints import CONFIG, judged, terms

from mdpo_rddl.session.race_checkpoints import RaceCheckpoints


def test_it_is_kept_between_two_iterations_too(tmp_path):
    checkpoints = RaceCheckpoints(tmp_path, terms(), 0.0)
    checkpoints.begun(lambda: 9.0)
    checkpoints.pulse()  # there is no policy yet
    assert list(tmp_path.iterdir()) == []
    checkpoints.judged(judged(-5.0, 1.0))
    checkpoints.pulse()
    again = RaceCheckpoints(tmp_path, terms(), 0.0)
    assert again.start.seconds == 9.0
    # a race that goes on keeps what it began with before anything is judged
    again.begun(lambda: 11.0)
    again.pulse()
    start = RaceCheckpoints(tmp_path, terms(), 0.0).start
    assert (start.seconds, start.incumbent.mean) == (11.0, -5.0)


def test_checkpoints_that_take_long_are_not_written_with_each_incumbent(tmp_path):
    checkpoints = RaceCheckpoints(tmp_path, terms(), 60.0)
    checkpoints.judged(judged(-5.0, 1.0))
    checkpoints._cost = 1.0  # as if it had taken a second
    checkpoints.judged(judged(-4.0, 2.0))
    checkpoints.pulse()
    assert RaceCheckpoints(tmp_path, terms(), 60.0).start.incumbent.mean == -5.0
    checkpoints._saved_at -= 20.0
    checkpoints.begun(lambda: 9.0)
    checkpoints.pulse()
    assert RaceCheckpoints(tmp_path, terms(), 60.0).start.incumbent.mean == -4.0
    # nothing is new
    checkpoints._saved_at -= 20.0
    checkpoints.begun(lambda: 30.0)
    checkpoints.pulse()
    assert RaceCheckpoints(tmp_path, terms(), 60.0).start.seconds == 9.0


def test_checkpoints_that_take_long_are_not_written_each_time_either(tmp_path):
    checkpoints = RaceCheckpoints(tmp_path, terms(), 0.0)
    checkpoints.begun(lambda: 9.0)
    checkpoints.judged(judged(-5.0, 1.0))
    checkpoints._cost = 1.0
    checkpoints.pulse()
    assert RaceCheckpoints(tmp_path, terms(), 0.0).start.seconds == 1.0
    checkpoints._saved_at -= 20.0
    checkpoints.pulse()
    assert RaceCheckpoints(tmp_path, terms(), 0.0).start.seconds == 9.0


def test_nothing_is_written_that_the_end_of_the_race_would_meet(tmp_path):
    checkpoints = RaceCheckpoints(tmp_path, terms(), 0.0)
    checkpoints.judged(judged(-5.0, CONFIG.budget().seconds - 2.0))
    again = RaceCheckpoints(tmp_path, terms(), 0.0)
    again.begun(lambda: 9.0)  # two seconds are left
    again._cost = 3.0
    later = judged(-4.0, CONFIG.budget().seconds - 1.0)
    again.judged(later)
    assert RaceCheckpoints(tmp_path, terms(), 0.0).start.incumbent.mean == -5.0
    again._cost = 1.0
    again.judged(later)
    assert RaceCheckpoints(tmp_path, terms(), 0.0).start.incumbent.mean == -4.0
