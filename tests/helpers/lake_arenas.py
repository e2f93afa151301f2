"""An arena on the lake, compiled once, and others on its programs."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from helpers.lakes import preset, write_lake
from mdpo_rddl.auto import RaceOptions
from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms.shared_weights import SharedWeightsArm
from mdpo_rddl.auto.common.candidate import NOOP
from mdpo_rddl.auto.race import race

FOREVER = 300.0


def lake_arena(folder: Path) -> Arena:
    """Of a race that lasts."""
    options = RaceOptions(most_iterations=100_000)
    return race._arena(write_lake(folder), preset(FOREVER), 0, time.monotonic(), options)


def in_arena(compiled: Arena, pulse: Callable[[], None] = lambda: None) -> Arena:
    """One whose judge knows the no-op only."""
    judge = Judge(128, 0, time.monotonic, compiled.began)
    judge._players = compiled.judge._players
    arena = replace(compiled, judge=judge, pulse=pulse)
    arena.__dict__.update(population=compiled.population, straight_line=compiled.straight_line)
    judge.record(arena.candidate("", NOOP, arena.noop))
    return arena


def shared(arena: Arena) -> SharedWeightsArm:
    return SharedWeightsArm(arena, NOOP)
