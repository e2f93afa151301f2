"""A policy from its file alone."""

from pathlib import Path

from mdpo_rddl.errors import InputError
from mdpo_rddl.policy import file
from mdpo_rddl.policy.kinds import AnyPolicy, restored
from mdpo_rddl.problem.functions import FunctionsGiven

# as run folders call it
_NAME = "policy.safetensors"


def load_policy(path: str | Path, functions: FunctionsGiven = None) -> AnyPolicy:
    """Reads a policy that `Policy.save` or `mdpo-plan` has written, and compiles what plays it.

    Args:
      path: of the file, or of a run folder.
      functions: those in Python that its domain calls, as `load_problem` takes them; no file of a
        policy holds code.

    Raises:
      InputError: naming the file, if it is missing, damaged, no such policy, its tensors do not
        fit its problem, or it does not hold its problem, as earlier run folders' do not.
    """
    from mdpo_rddl.machine.jax_setup import kept_tables

    where, folder = Path(path), None
    if where.is_dir():
        where, folder = where / _NAME, where
    saved = file.load_policy(where, folder)
    if saved.source is None:
        raise InputError(f"{where}: holds no RDDL: evaluate its run folder with mdpo-plan --load")
    return restored(saved, saved.source.load(kept_tables(), functions), str(where))
