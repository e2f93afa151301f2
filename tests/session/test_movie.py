"""An episode as a movie: its frames, and what is said where there can be none."""

import shutil

import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.tanks import DOMAIN, INSTANCE
from helpers.toys import problem_from
from PIL import Image, ImageSequence

from mdpo_rddl.problem import visualizer
from mdpo_rddl.problem.load import load_problem, make_environment
from mdpo_rddl.problem.visualizer import drawing
from mdpo_rddl.session import movie
from mdpo_rddl.session.movie import write_movie


class Colours:
    """A visualizer: frame n is of the n-th shade of red."""

    def __init__(self, model):
        self.frames = 0

    def render(self, state):
        self.frames += 1
        return Image.new("RGB", (31 + self.frames % 2, 20), (self.frames * 40, 0, 0))


class Broken(Colours):
    def render(self, state):
        raise ZeroDivisionError("no canvas")


@pytest.fixture(scope="module")
def tanks():
    return problem_from(DOMAIN + INSTANCE, horizon=3)


def noop(step, state):
    return {}


def test_a_movie_has_a_frame_for_each_state(tanks, tmp_path, monkeypatch):
    monkeypatch.setattr(visualizer, "_own_visualizer", lambda problem: Colours)
    path = tmp_path / "deep" / "episode.gif"
    write_movie(path, noop, tanks, seed=0)
    with Image.open(path) as film:
        reds = [np.asarray(f.convert("RGB"))[0, 0, 0] for f in ImageSequence.Iterator(film)]
        assert film.size == (30, 20)
    # four states, the first frame was a trial
    assert reds == [80, 120, 160, 200]


def test_a_long_episode_is_thinned(tanks, tmp_path, monkeypatch):
    monkeypatch.setattr(visualizer, "_own_visualizer", lambda problem: Colours)
    monkeypatch.setattr(movie, "_MOST_FRAMES", 2)
    write_movie(tmp_path / "episode.gif", noop, tanks, seed=0)
    with Image.open(tmp_path / "episode.gif") as film:
        assert film.n_frames == 3


def test_charts_stand_in_for_a_visualizer_that_fails(tanks, monkeypatch, caplog):
    monkeypatch.setattr(visualizer, "_own_visualizer", lambda problem: Broken)
    env = make_environment(tanks)
    env.reset(seed=0)
    frame = drawing(tanks, env)()
    assert frame.size == (700, 600)
    assert "Broken draws nothing here (ZeroDivisionError: no canvas): charts" in caplog.text


def test_a_problem_of_the_repository_has_its_own_visualizer(tanks):
    found = visualizer._own_visualizer(load_problem("HVAC_ippc2023", "1"))
    assert found.__name__ == "HVACVisualizer"
    assert visualizer._own_visualizer(tanks) is None


def test_what_cannot_be_written_is_told_in_a_line(tanks, tmp_path, monkeypatch):
    avi = tmp_path / "a.avi"
    assert one_line(lambda: write_movie(avi, noop, tanks, 0)).endswith("ends with .gif or .mp4")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    said = one_line(lambda: write_movie(tmp_path / "a.mp4", noop, tanks, 0))
    assert "needs ffmpeg" in said


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no ffmpeg on this machine")
def test_a_video(tanks, tmp_path, monkeypatch):
    monkeypatch.setattr(visualizer, "_own_visualizer", lambda problem: Colours)
    write_movie(tmp_path / "episode.mp4", noop, tanks, seed=0)
    assert (tmp_path / "episode.mp4").read_bytes()[4:8] == b"ftyp"


def test_a_visualizer_that_fails_costs_the_movie_alone(tanks, tmp_path, monkeypatch, caplog):
    def broken(*arguments):
        raise ValueError("no\npicture")

    monkeypatch.setattr(movie, "write_movie", broken)
    movie.draw_movie(tmp_path / "episode.gif", noop, tanks, 0)
    assert caplog.messages == ["no movie: no picture"]


def test_an_interrupt_costs_the_movie_alone_and_leaves_no_half_of_it(
    tanks, tmp_path, monkeypatch, caplog
):
    class Impatient(Colours):
        def render(self, state):
            if self.frames == 2:
                raise KeyboardInterrupt
            return super().render(state)

    monkeypatch.setattr(visualizer, "_own_visualizer", lambda problem: Impatient)
    movie.draw_movie(tmp_path / "episode.gif", noop, tanks, 0)
    assert caplog.messages == ["no movie: stopped while it was drawn"]
    assert list(tmp_path.iterdir()) == []


def test_a_film_that_cannot_be_written_whole_leaves_the_earlier_one(tanks, tmp_path, monkeypatch):
    path = tmp_path / "episode.gif"
    path.write_bytes(b"earlier")

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(visualizer, "_own_visualizer", lambda problem: Colours)
    monkeypatch.setattr("os.fsync", full)
    said = one_line(lambda: write_movie(path, noop, tanks, seed=0))
    assert said == f"{path}: cannot be written: No space left on device"
    assert [(each.name, each.read_bytes()) for each in tmp_path.iterdir()] == [
        ("episode.gif", b"earlier")
    ]
