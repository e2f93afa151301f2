"""What commands set up in JAX."""

import jax
import pytest

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine import jax_setup


@pytest.mark.parametrize("error", [AssertionError(), RuntimeError("no device")])
def test_a_platform_that_is_not_there_is_one_line(error, monkeypatch):
    def refuse():
        raise error

    monkeypatch.setattr(jax, "devices", refuse)
    monkeypatch.setenv("JAX_PLATFORMS", "cuda")
    said = str(error) or "JAX finds no device of JAX_PLATFORMS=cuda"
    with pytest.raises(InputError, match=f"the environment: {said}"):
        jax_setup.require_devices()
