"""Any tree of arrays comes back from a policy file bit for bit, and no bit may change."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mdpo_rddl.errors import InputError
from mdpo_rddl.policy.file import SavedPolicy, load_policy, save_policy

KINDS = st.sampled_from([np.float32, np.float64, np.int32, np.int64, np.bool_, np.uint8])
ARRAYS = arrays.arrays(KINDS, arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4))
# what separates the parts of a path, and what no text file holds
NAMES = st.text(st.characters(exclude_characters="/", exclude_categories=["Cs"]), max_size=6)
# a part of a tuple is named so
NAMES = NAMES.filter(lambda name: not re.fullmatch(r"\[[0-9]+\]", name))
TREES = st.dictionaries(
    NAMES,
    st.recursive(
        ARRAYS,
        lambda inner: (
            st.dictionaries(NAMES, inner, min_size=1, max_size=3)
            | st.tuples(inner)
            | st.tuples(inner, inner)
        ),
        max_leaves=5,
    ),
    min_size=1,
    max_size=3,
)
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=40)
POLICIES = st.builds(
    SavedPolicy,
    TREES,
    st.dictionaries(NAMES, ARRAYS, max_size=2),
    TEXT,
    st.dictionaries(TEXT, TEXT | st.integers(), max_size=3),
    st.integers(0, 2**31 - 1),
)


def assert_same(one, other):
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_same(one[key], other[key])
    elif isinstance(one, tuple):
        assert isinstance(other, tuple)
        for part, again in zip(one, other, strict=True):
            assert_same(part, again)
    else:
        assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())


@given(POLICIES)
def test_a_policy_comes_back(tmp_path_factory, policy):
    path = tmp_path_factory.mktemp("policy") / "p.safetensors"
    save_policy(path, policy)
    loaded = load_policy(path)
    assert_same(policy.params, loaded.params)
    assert_same(policy.policy_hyperparams, loaded.policy_hyperparams)
    assert (loaded.config, loaded.problem, loaded.seed) == (
        policy.config,
        policy.problem,
        policy.seed,
    )


@given(POLICIES, st.data())
def test_no_bit_of_any_policy_may_change(tmp_path_factory, policy, data):
    path = tmp_path_factory.mktemp("policy") / "p.safetensors"
    save_policy(path, policy)
    content = bytearray(path.read_bytes())
    position = data.draw(st.integers(0, 8 * len(content) - 1), label="bit")
    content[position // 8] ^= 1 << position % 8
    path.write_bytes(content)
    with pytest.raises(InputError):
        load_policy(path)
