"""JAX's default device, for a block and for work in other threads."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp

from mdpo_rddl.machine.device import chosen_device, computing_on, current_device, is_on_cpu

# what is asked for on the second of two devices
SECOND = """
import time

import jax
import jax.numpy as jnp
from mdpo_rddl.machine.background import Background
from mdpo_rddl.machine.device import as_here, computing_on, current_device

first, second = jax.devices()
found = []
with computing_on(second):
    assert current_device() == second
    background = Background(as_here(lambda: found.append(jnp.ones(1).devices())))
    found.append(jnp.ones(1).devices())
background.join()
assert found == [{second}, {second}], found
assert current_device() == first
assert jnp.ones(1).devices() == {first}
"""


def run_with_two_devices(program):
    variables = {**os.environ, "JAX_NUM_CPU_DEVICES": "2"}
    subprocess.run([sys.executable, "-c", program], env=variables, check=True)


def test_a_block_and_work_handed_to_a_thread_compute_on_its_device():
    run_with_two_devices(SECOND)


def test_nothing_chosen_is_what_jax_puts_first():
    assert chosen_device() is None
    with computing_on(None):
        assert current_device() == jax.devices()[0]
        assert jnp.ones(1).devices() == {jax.devices()[0]}


def test_a_platform_may_be_named():
    with computing_on("cpu"):
        assert current_device() == jax.devices("cpu")[0]
        assert is_on_cpu()
