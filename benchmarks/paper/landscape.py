"""The return over two constant actions, exact and relaxed: the paper's first figure."""

import json
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import random

from benchmarks.paper.relaxation import with_relaxation
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import read_json, write_atomically
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.planner.exact.returns import compile_returns
from mdpo_rddl.problem.load import Problem, load_problem

EXACT = "exact"
WEIGHTS = (50.0, 2.0, 0.01)
_PROBLEM = "powergen2"
_ACTION = "curProd"
_LOW, _HIGH = 1.0, 6.0
_ROLLOUTS = 16
_FILE = "landscape.json"


class Landscape(NamedTuple):
    """Mean returns of constant actions.

    Attributes:
      actions: values of either action [N].
      returns: per model, `EXACT` or its weight, the mean returns [N, N]: first action, second.
    """

    actions: np.ndarray
    returns: dict[str, np.ndarray]


def run_landscape(out: Path, points: int = 51) -> None:
    """Computes the landscapes and writes them, unless they are there.

    The rollouts of all pairs and models have the same random numbers.

    Args:
      out: results folder.
      points: values of each action, in [1, 6].
    """
    known = load_landscape(out)
    if known is not None and len(known.actions) == points:
        return
    problem = load_problem(_PROBLEM)
    actions = np.linspace(_LOW, _HIGH, points)
    models = {EXACT: None, **{f"w = {weight:g}": weight for weight in WEIGHTS}}
    returns = {name: _returns(problem, weight, actions) for name, weight in models.items()}
    content = {
        "problem": problem.digest,
        "rollouts": _ROLLOUTS,
        "actions": actions.tolist(),
        "returns": {name: np.round(values, 2).tolist() for name, values in returns.items()},
    }
    write_atomically(out / _FILE, json.dumps(content) + "\n")


def load_landscape(out: Path) -> Landscape | None:
    """What `run_landscape` wrote; None if there is nothing.

    Raises:
      InputError: if the file is something else.
    """
    path = out / _FILE
    try:
        content = read_json(path, out)
        returns = {name: np.array(values) for name, values in content["returns"].items()}
        return Landscape(np.array(content["actions"]), returns)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: is not a landscape of the paper: {error!r}") from error


def _returns(problem: Problem, weight: float | None, actions: np.ndarray) -> np.ndarray:
    planner = build_planner(problem, _config(problem.domain_name, weight)).planner
    returns = compile_returns(planner, relaxed=weight is not None)
    pairs = np.stack(np.meshgrid(actions, actions, indexing="ij"), axis=-1).reshape(-1, 1, 2)
    plans = {_ACTION: jnp.asarray(np.repeat(pairs, problem.horizon, axis=1), jnp.float32)}
    keys = jnp.broadcast_to(random.PRNGKey(0), (len(pairs), 2))
    means = np.asarray(returns(keys, plans)).mean(axis=1).astype(float)
    return means.reshape(len(actions), len(actions))


def _config(domain_name: str, weight: float | None) -> PlannerConfig:
    """Constant plans on a model whose values, not only their gradients, are relaxed."""
    config = PRESETS["paper"](domain_name).with_values(
        "Planner",
        method="JaxStraightLinePlan",
        method_kwargs={},
        batch_size_train=_ROLLOUTS,
        batch_size_test=_ROLLOUTS,
    )
    config = config.without_noise()
    if weight is None:
        return config
    return with_relaxation(config, weight, values_too=True)
