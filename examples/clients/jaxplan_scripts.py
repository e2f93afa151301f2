"""Runs JaxPlan's own example scripts with one import changed: the planner is MDPO's.

    python examples/clients/jaxplan_scripts.py run_plan Reservoir_ippc2023 1 slp
    python examples/clients/jaxplan_scripts.py run_tune Reservoir_ippc2023 1 slp 1 2 1

The scripts are those of the installed package pyRDDLGym-jax, with the arguments that they take:
`run_plan` (training, or replanning with the method `replan`), `run_scipy` and `run_tune`. A
configuration with `dashboard=True` shows the dashboard, as with JaxPlan.
"""

import inspect
import subprocess
import sys
import tempfile
from pathlib import Path

from pyRDDLGym_jax.core import planner

EXAMPLES = Path(inspect.getfile(planner)).parents[1] / "examples"
# what the scripts import, and what from; the first name is the class that is replaced
IMPORTS = {
    "from pyRDDLGym_jax.core.planner import": (
        "from mdpo_rddl import",
        "JaxBackpropPlanner",
        "MDPOPlanner as JaxBackpropPlanner",
    ),
    "from pyRDDLGym_jax.core.tuning import": (
        "from mdpo_rddl.planner.tuning import",
        "JaxParameterTuning",
        "MDPOParameterTuning as JaxParameterTuning",
    ),
}


def with_mdpo(text: str) -> str:
    """A script's text with its import of JaxPlan's planner or tuner changed to MDPO's.

    Raises:
      ValueError: if it has no such import.
    """
    for theirs, (ours, name, our_name) in IMPORTS.items():
        before, found, after = text.partition(theirs)
        if found:
            return before + ours + after.replace(name, our_name, 1)
    raise ValueError("the script imports neither JaxPlan's planner nor its tuner")


def write_script(name: str, folder: Path, configs: Path = EXAMPLES / "configs") -> Path:
    """Writes a script with its import changed, beside the configurations that it reads.

    Args:
      name: of the script, without `.py`.
      folder: where to.
      configs: the folder of the configurations.

    Raises:
      SystemExit: if JaxPlan has no script of this name that plans.
    """
    known = sorted(path.stem for path in EXAMPLES.glob("run_*.py"))
    if name not in known:
        raise SystemExit(f"{name}: JaxPlan has no such script; it has {', '.join(known)}")
    try:
        text = with_mdpo((EXAMPLES / f"{name}.py").read_text(encoding="utf-8"))
    except ValueError as error:
        raise SystemExit(f"{name}: {error}") from error
    script = folder / f"{name}.py"
    script.write_text(text, encoding="utf-8")
    (folder / "configs").symlink_to(configs, target_is_directory=True)
    return script


def main(arguments: list[str]) -> int:
    """Runs a script by its name with the rest of the arguments; returns its exit status."""
    if not arguments:
        raise SystemExit(__doc__)
    name, *rest = arguments
    with tempfile.TemporaryDirectory() as folder:
        # a process of its own, since the tuner's workers import the script
        script = write_script(name, Path(folder))
        return subprocess.run([sys.executable, str(script), *rest], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
