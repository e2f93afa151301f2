"""The tests leave the user's cache folder alone, and so does what they start."""

import os
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
from helpers.caches import own_caches
from helpers.files import contents
from helpers.plan_command import write_problem

from mdpo_rddl.machine.cache import cache_folder

PLAN = "-m mdpo_rddl.cli.plan tanks.rddl two.rddl --config config.cfg --iterations 1 --episodes 1"
CONFIG = """\
[Compiler]
[Planner]
method='JaxStraightLinePlan'
optimizer='rmsprop'
optimizer_kwargs={'learning_rate': 0.1}
pgpe=None
rollout_horizon=2
[Optimize]
key=5
"""


def test_every_cache_of_this_process_is_the_session_s():
    import jax

    kept = own_caches()
    assert cache_folder().is_relative_to(kept)
    assert Path(jax.config.jax_compilation_cache_dir).is_relative_to(kept)
    assert Path(mpl.get_cachedir()).is_relative_to(kept)
    assert Path(mpl.get_configdir()).is_relative_to(kept)
    assert not kept.is_relative_to(Path.home() / ".cache")


def test_a_command_that_a_test_starts_leaves_nothing_at_home(tmp_path):
    home, work = tmp_path / "home", tmp_path / "work"
    home.mkdir()
    work.mkdir()
    write_problem(work)
    (work / "config.cfg").write_text(CONFIG)
    before = contents(own_caches())
    done = subprocess.run(
        [sys.executable, *PLAN.split(), "--out", "run"],
        cwd=work,
        env={**os.environ, "HOME": str(home)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (work / "run" / "learning_curve.png").is_file()
    assert contents(home) == {}
    # it did keep what it compiled
    assert set(contents(own_caches())) > set(before)
