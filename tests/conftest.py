"""Caches of the tests' own, shared helpers that are importable, and cheap compilation."""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from helpers.caches import use_own_caches
from hypothesis import settings

# as fast to compile as can be; children inherit it
os.environ.setdefault(
    "XLA_FLAGS", "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"
)
# before anything imports JAX or matplotlib
use_own_caches()

settings.register_profile("few", derandomize=True, database=None, deadline=None, max_examples=25)
settings.load_profile("few")

# its fixtures serve several files
pytest_plugins = ["helpers.plan_command"]
