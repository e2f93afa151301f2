"""Whatever is proposed and however it is perturbed, the action is in its box."""

import jax.numpy as jnp
import numpy as np
import pytest
from helpers.x64 import enable_x64
from hypothesis import given
from hypothesis import strategies as st

from mdpo_rddl.noise.actions import ActionKind, ActionSpec
from mdpo_rddl.noise.projection import perturb_and_project, project_and_perturb

INF = np.inf
SIZE = 3
BOUNDS = st.one_of(st.just(-INF), st.just(INF), st.floats(-1e6, 1e6, width=32))
VALUES = st.floats(-1e8, 1e8, width=32)


def rows(values):
    return st.lists(values, min_size=SIZE, max_size=SIZE)


@st.composite
def boxes(draw):
    pairs = [sorted(pair) for pair in zip(draw(rows(BOUNDS)), draw(rows(BOUNDS)), strict=True)]
    # an upper bound of -inf, or a lower one of inf, is no box
    lower, upper = np.array(
        [(-INF if a == INF else a, INF if b == -INF else b) for a, b in pairs]
    ).T
    kind = draw(st.sampled_from([ActionKind.REAL, ActionKind.INTEGER, ActionKind.BOOL]))
    return ActionSpec("a", (SIZE,), kind, lower, upper, squashed=draw(st.booleans()))


@pytest.mark.parametrize("project", [perturb_and_project, project_and_perturb])
@given(boxes(), rows(VALUES), rows(VALUES), st.sampled_from([np.float32, np.float64]))
def test_the_action_is_in_its_box(project, spec, raw, shift, dtype):
    with enable_x64(dtype is np.float64):
        raw, shift = (jnp.asarray(np.array(values), dtype) for values in (raw, shift))
        if spec.kind is ActionKind.BOOL:
            raw, lower, upper = jnp.clip(jnp.abs(raw), 0.0, 1.0), np.zeros(SIZE), np.ones(SIZE)
        else:
            lower, upper = spec.lower.astype(dtype), spec.upper.astype(dtype)
        action = project({"a": raw}, {"a": shift}, {"a": spec})["a"]
        assert action.dtype == dtype
        assert action.shape == (SIZE,)
        action = np.asarray(action)
    assert np.all(np.isfinite(action))
    assert np.all(action >= lower)
    assert np.all(action <= upper)


@given(boxes(), rows(VALUES))
def test_what_is_not_perturbed_stays_as_it_is(spec, raw):
    raw = jnp.asarray(np.float32(raw))
    kept = perturb_and_project({"a": raw, "b": raw}, {"b": jnp.zeros(SIZE)}, {"b": spec})
    np.testing.assert_array_equal(kept["a"], raw)
