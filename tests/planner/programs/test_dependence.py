"""Which results depend on which switches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mdpo_rddl.planner.programs.dependence import dependence

S = 4
NEXT = np.eye(S, k=1, dtype=bool)
STATE = jnp.array([True, False, True, False])
OWN = np.eye(S, dtype=bool)
NONE, ALL = np.zeros((S, S), bool), np.ones((S, S), bool)

CASES = {
    "own": (lambda on, s: on ^ s, OWN),
    "of the next": (lambda on, s: jnp.any(NEXT & on, axis=1), NEXT.T),
    "for all": (lambda on, s: jnp.all(~NEXT | on, axis=1), NEXT.T),
    "as numbers": (lambda on, s: jnp.sum(NEXT * on.astype(jnp.float32), axis=1), NEXT.T),
    "moved": (lambda on, s: jnp.concatenate([on[2:], on[:2]]), np.roll(OWN, 2, axis=1)),
    "turned": (lambda on, s: jnp.transpose(jnp.broadcast_to(on, (2, S)))[:, 0], OWN),
    "chosen": (lambda on, s: jnp.where(np.arange(S) < 2, on, s), OWN & (np.arange(S) < 2)),
    "asked": (lambda on, s: jnp.where(on, s, ~s), OWN),
    "the largest": (lambda on, s: jnp.max(NEXT * on.astype(jnp.int32), axis=1), NEXT.T),
    "neither": (lambda on, s: s, NONE),
    "constant": (lambda on, s: on & np.zeros(S, bool), NONE),
    "not looked into": (lambda on, s: jnp.cumsum(on), ALL),
    "called": (lambda on, s: jax.jit(lambda x: x ^ s)(on), OWN),
    "drawn": (lambda on, s: jax.random.uniform(jax.random.PRNGKey(0), (S,)) < on, OWN),
    "one number": (lambda on, s: s & on[0], np.arange(S)[:, np.newaxis] == np.zeros(S, int)),
    "absorbed": (lambda on, s: jnp.all(NEXT & on, axis=1), NONE),
}


@pytest.mark.parametrize("name", CASES)
def test_each_entry_depends_on_what_it_is_made_of(name):
    function, expected = CASES[name]
    program = jax.make_jaxpr(function)(jnp.zeros(S, bool), STATE)
    (found,) = dependence(program, [OWN, None], S)
    np.testing.assert_array_equal(found, expected)


def test_what_changes_is_among_what_may_depend():
    """Tried on a program of all kinds, at random."""
    relation = np.random.default_rng(1).random((S, S)) < 0.4

    def function(on, state):
        near = jnp.any(relation & on, axis=1) | (state & ~on)
        return jnp.sum(jnp.where(relation, near.astype(jnp.float32), 2.0), axis=0)

    program = jax.make_jaxpr(function)(jnp.zeros(S, bool), STATE)
    (found,) = dependence(program, [OWN, None], S)
    changed = np.zeros_like(found)
    for state in (STATE, ~STATE, STATE & False):
        for on in np.stack(np.meshgrid(*[[False, True]] * S), -1).reshape(-1, S):
            before = function(jnp.asarray(on), state)
            for switch in range(S):
                other = function(jnp.asarray(on ^ OWN[switch]), state)
                changed[switch] |= np.asarray(before != other)
    assert changed.any()
    assert not np.any(changed & ~found)
