"""Parameters as vectors and back."""

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.auto.search.flat import Flat

TREE = {"a": np.float32(2.0), "b": [np.arange(6.0).reshape(2, 3), jnp.arange(2)]}


def test_a_vector_has_the_numbers_of_all_leaves_in_order():
    np.testing.assert_array_equal(Flat.vector(TREE), [2, 0, 1, 2, 3, 4, 5, 0, 1])


def test_a_tree_of_its_vector_is_the_same():
    again = Flat(TREE).tree(Flat.vector(TREE))
    assert jax.tree.structure(again) == jax.tree.structure(TREE)
    for one, two in zip(jax.tree.leaves(again), jax.tree.leaves(TREE), strict=True):
        np.testing.assert_array_equal(one, two)
        assert (one.dtype, one.shape) == (np.asarray(two).dtype, np.shape(two))


def test_trees_of_several_vectors_have_their_leading_axes():
    vectors = np.arange(2 * 4 * 9.0).reshape(2, 4, 9)
    trees = Flat(TREE).tree(vectors)
    assert trees["a"].shape == (2, 4)
    assert trees["b"][0].shape == (2, 4, 2, 3)
    np.testing.assert_array_equal(trees["b"][1][1, 2], vectors[1, 2, 7:])


def test_a_tree_without_leaves_has_no_numbers():
    assert Flat.vector({}).shape == (0,)
    assert Flat({}).tree(np.zeros((3, 0))) == {}
