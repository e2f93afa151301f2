"""Makes the tests' shared helpers importable, and compilation, most of the time, cheaper."""

import os
import sys
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
sys.path.insert(0, str(Path(__file__).parent))

# its fixtures serve several files
pytest_plugins = ["helpers.plan_command"]
