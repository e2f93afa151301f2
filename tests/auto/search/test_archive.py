"""Where plans have led."""

import numpy as np

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
    prefixes = {float(np.sum(plan[:step])): step for plan, step in archive._prefixes}
    assert prefixes == {0.25: 1, 0.5: 1, 1.0: 2, 1.5: 3, 2.0: 4}
    made = archive.plans(20)
    assert made.shape == (20, 4, 1)
    again = Archive(layout_of({"push": np.zeros((4, 1))}, []), {"x": (0.0, 1.0)}, seed=0)
    again.add(plans, {"x": np.cumsum(plans, axis=1)[:, :, 0]})
    np.testing.assert_array_equal(again.plans(20), made)
