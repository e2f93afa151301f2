"""No part of a race draws another part's random numbers."""

import jax
import numpy as np

from mdpo_rddl.auto.common.draws import Draws, key_for


def test_the_judge_plays_with_numbers_that_no_iteration_of_a_search_has_seen():
    # what judging draws from, and what each part folds its iterations into
    keys = {tuple(np.asarray(key_for(Draws.JUDGE, 3)).tolist())}
    iterations = [*range(50), *range(10**6, 10**6 + 10)]
    searching = [part for part in Draws if part is not Draws.JUDGE]
    for part in searching:
        for iteration in iterations:
            key = jax.random.fold_in(key_for(part, 3), iteration)
            keys.add(tuple(np.asarray(key).tolist()))
    assert len(keys) == 1 + len(searching) * len(iterations)


def test_seeds_differ():
    one, other = (np.asarray(key_for(Draws.JUDGE, seed)) for seed in (0, 1))
    assert not np.array_equal(one, other)
