"""Where plans have led."""

import numpy as np

from mdpo_rddl.auto.search import archive as archives
from mdpo_rddl.auto.search.archive import Archive
from mdpo_rddl.auto.search.mutations import layout_of


def test_an_archive_keeps_the_shortest_way_to_each_cell():
    archive = Archive(layout_of({"push": np.zeros((4, 1))}, []), {"x": (0.0, 1.0)}, seed=0)
    slow, fast = np.full((4, 1), 0.25), np.full((4, 1), 0.5)
    plans = np.stack([slow, fast]).astype(np.float32)
    archive.add(plans, {"x": np.cumsum(plans, axis=1)[:, :, 0]})
    # cells are half a scale wide: [0.0, 0.5), ..., [2.0, 2.5)
    assert len(archive) == 5
    # two steps of 0.25 lead into the second cell, and one of 0.5
    ways = list(zip(archive._prefixes, archive._steps[:5].tolist(), strict=True))
    prefixes = {float(np.sum(plan[:step])): step for plan, step in ways}
    assert prefixes == {0.25: 1, 0.5: 1, 1.0: 2, 1.5: 3, 2.0: 4}
    made = archive.plans(20)
    assert made.shape == (20, 4, 1)
    assert all(any(np.all(plan[:step] == way[:step]) for way, step in ways) for plan in made)
    again = Archive(layout_of({"push": np.zeros((4, 1))}, []), {"x": (0.0, 1.0)}, seed=0)
    again.add(plans, {"x": np.cumsum(plans, axis=1)[:, :, 0]})
    np.testing.assert_array_equal(again.plans(20), made)


def test_an_archive_keeps_to_its_bytes_however_often_its_plans_improve(monkeypatch):
    horizon, places = 10, 50
    monkeypatch.setattr(archives, "_MOST_BYTES", 8 * horizon * places * 4)
    layout = layout_of({"push": np.zeros((horizon, places))}, [])
    archive, random = Archive(layout, {"x": (0.0, 1.0)}, seed=0), np.random.default_rng(0)
    for speed in (0.5, 1.0, 2.0, 3.0, 5.0):
        plans = np.zeros((6, horizon, places), np.float32)
        moves = random.choice([-1.0, 0.0, 1.0], size=(6, horizon)) * speed
        archive.add(plans, {"x": np.cumsum(moves, axis=1)})
        kept = {id(plan): plan.nbytes for plan in archive._prefixes}
        assert 0 < sum(kept.values()) == archive._bytes <= archives._MOST_BYTES
    # of a way in two steps nothing more is kept
    short = Archive(layout, {"x": (0.0, 1.0)}, seed=0)
    short.add(plans[:1], {"x": np.array([[0.0, 1.0] * (horizon // 2)])})
    assert len(short) == 2
    assert short._bytes == 2 * places * 4
    assert short.plans(3).shape == (3, horizon, places)


def test_beyond_the_way_actions_are_held_for_a_while():
    horizon = 200
    archive = Archive(layout_of({"push": np.zeros((horizon, 3))}, []), {"x": (0.0, 1.0)}, seed=0)
    archive.add(np.full((1, horizon, 3), 9.0, np.float32), {"x": np.zeros((1, horizon))})
    plans = archive.plans(50)
    # one step leads to the only cell
    assert np.all(plans[:, 0] == 9.0)
    later = plans[:, 1:]
    assert np.abs(later).max() <= 1.0
    changes = np.count_nonzero(np.diff(later, axis=1), axis=1)
    acts = np.any(later, axis=1)
    # some actions are left alone, and none changes at every step
    assert not np.all(acts)
    assert 1 < np.mean(changes[acts]) < horizon / 4
