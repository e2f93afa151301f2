"""An episode as a movie."""

import io
import logging
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from mdpo_rddl.errors import InputError, note_heard
from mdpo_rddl.machine.files import write_atomically
from mdpo_rddl.problem.episode import Policy, WatchedPolicy
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.problem.visualizer import drawing

logger = logging.getLogger(__name__)

MOVIE_SUFFIXES = (".gif", ".mp4")
_MOST_FRAMES, _WIDEST = 200, 720
_FRAMES_A_SECOND = 8


def check_movie(path: Path) -> None:
    """Whether a movie can be written to a file.

    Raises:
      InputError: if its suffix is neither .gif nor .mp4, or ffmpeg is missing for the latter.
    """
    if path.suffix not in MOVIE_SUFFIXES:
        raise InputError(f"{path}: a movie ends with {' or '.join(MOVIE_SUFFIXES)}")
    if path.suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(f"{path}: writing .mp4 needs ffmpeg, which is not there; .gif does not")


def draw_movie(path: Path, policy: Policy, problem: Problem, seed: int) -> None:
    """`write_movie` for a run that is done: a mistake or an interrupt costs the movie alone."""
    try:
        write_movie(path, policy, problem, seed)
    except KeyboardInterrupt as stop:
        note_heard(stop)
        logger.warning("no movie: stopped while it was drawn")
    except Exception as error:  # whatever somebody's visualizer raises
        logger.warning("no movie: %s", " ".join(f"{error}".split()) or type(error).__name__)


def write_movie(path: Path, policy: Policy, problem: Problem, seed: int) -> None:
    """Plays the first episode of an evaluation and writes its states as a movie.

    The domain's own visualizer draws them where rddlrepository has one, else pyRDDLGym's charts.
    Of a long episode every n-th step is drawn.

    Args:
      path: a .gif or .mp4 file.
      policy: what is played.
      problem: on which.
      seed: of the evaluation.

    Raises:
      InputError: as `check_movie` does, or if the file cannot be written.
    """
    check_movie(path)
    env, frames = make_environment(problem), list[Image.Image]()
    env.reset(seed=0)
    draw, stride = drawing(problem, env), -(-problem.horizon // _MOST_FRAMES)

    def watched(step: int, state: Mapping[str, Any]) -> Mapping[str, Any]:
        if step % stride == 0:
            frames.append(_small(draw()))
        return policy(step, state)

    evaluate(env, WatchedPolicy(policy, watched), episodes=1, seed=seed)
    frames.append(_small(draw()))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        (_write_gif if path.suffix == ".gif" else _write_mp4)(path, frames)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def _small(frame: Image.Image) -> Image.Image:
    frame = frame.convert("RGB")
    frame.thumbnail((_WIDEST, _WIDEST))
    # video formats want even sides
    width, height = (side - side % 2 for side in frame.size)
    return frame.crop((0, 0, width, height))


def _write_gif(path: Path, frames: Sequence[Image.Image]) -> None:
    first, *rest = (frame.quantize(64) for frame in _same_size(frames))
    duration = 1000 // _FRAMES_A_SECOND
    film, options = io.BytesIO(), {"append_images": rest, "duration": duration, "loop": 0}
    first.save(film, format="GIF", save_all=True, **options)
    write_atomically(path, film.getvalue())


def _write_mp4(path: Path, frames: Sequence[Image.Image]) -> None:
    frames = _same_size(frames)
    width, height = frames[0].size
    pixels = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"]
    into = ["-r", str(_FRAMES_A_SECOND), "-i", "-", "-pix_fmt", "yuv420p"]
    content = b"".join(frame.tobytes() for frame in frames)
    with tempfile.TemporaryDirectory(prefix=".", dir=path.parent) as folder:
        film = Path(folder) / path.name
        command = ["ffmpeg", "-y", "-loglevel", "error", *pixels, *into, str(film)]
        done = subprocess.run(command, input=content, capture_output=True, check=False)
        if done.returncode:
            cause = " ".join(done.stderr.decode(errors="replace").split())
            raise InputError(f"{path}: ffmpeg cannot write it: {cause}")
        film.replace(path)


def _same_size(frames: Sequence[Image.Image]) -> list[Image.Image]:
    """The frames as large as the first one: a visualizer may crop each in its own way."""
    size = frames[0].size
    return [frame if frame.size == size else frame.resize(size) for frame in frames]
