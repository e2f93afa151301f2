"""A trained policy as a safetensors file: tensors and text, nothing that executes."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
from safetensors.numpy import save

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import write_atomically
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.source import ProblemSource

FORMAT = "mdpo-rddl policy 1"


@dataclass(frozen=True)
class SavedPolicy:
    """What is needed to play a policy again.

    Attributes:
      params: tree of parameters, nested dictionaries of arrays.
      policy_hyperparams: JaxPlan's policy hyperparameters, nested likewise.
      config: the planner's configuration, as a `.cfg` file's text.
      problem: identity of the problem: `domain`, `instance`, `label`, `horizon`, `digest`.
      seed: of the run that trained it.
      source: the problem's texts, with which the file stands alone; None if it has none.
      candidates: what planning judged on the way, in its order, as JSON can hold it.
    """

    params: dict[str, Any]
    policy_hyperparams: dict[str, Any]
    config: str
    problem: dict[str, Any]
    seed: int
    source: ProblemSource | None = None
    candidates: tuple[Mapping[str, Any], ...] = ()


def problem_identity(problem: Problem) -> dict[str, Any]:
    """What tells one problem from another."""
    return {
        "domain": problem.domain_name,
        "instance": problem.instance_name,
        "label": problem.label,
        "horizon": problem.horizon,
        "digest": problem.digest,
    }


def save_policy(path: Path, policy: SavedPolicy) -> None:
    """Writes a policy.

    Raises:
      InputError: if the file cannot be written.
      ValueError: if a tree holds anything but nested dictionaries with string keys.
    """
    tensors = {
        **flatten(policy.params, "params"),
        **flatten(policy.policy_hyperparams, "hyperparams"),
    }
    metadata = {
        "format": FORMAT,
        "config": policy.config,
        "problem": json.dumps(policy.problem),
        "seed": str(policy.seed),
    }
    if policy.source is not None:
        metadata["source"] = json.dumps(dataclasses.asdict(policy.source))
    if policy.candidates:
        metadata["candidates"] = json.dumps(policy.candidates)
    metadata["digest"] = _digest(tensors, metadata)
    write_atomically(path, save(tensors, metadata=metadata))


def load_policy(path: Path) -> SavedPolicy:
    """Reads a policy back, bit for bit.

    Raises:
      InputError: naming the file, if it is missing, damaged or not such a policy.
    """
    try:
        with safetensors.safe_open(str(path), framework="numpy") as file:
            metadata = file.metadata() or {}
            if metadata.get("format") != FORMAT:
                found = metadata.get("format")
                raise InputError(f"{path}: not a policy of mdpo-rddl (format {found!r})")
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such policy") from error
    except (OSError, safetensors.SafetensorError) as error:
        cause = " ".join(str(error).split())
        raise InputError(f"{path}: damaged policy file: {cause}") from error
    if metadata.pop("digest", None) != _digest(tensors, metadata):
        raise InputError(f"{path}: damaged policy file: its contents do not match their digest")
    try:
        trees = unflatten(tensors)
        return SavedPolicy(
            params=trees["params"],
            policy_hyperparams=trees.get("hyperparams", {}),
            config=metadata["config"],
            problem=json.loads(metadata["problem"]),
            seed=int(metadata["seed"]),
            source=_source(metadata),
            candidates=tuple(json.loads(metadata.get("candidates", "[]"))),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged policy file: {error!r}") from error


def _source(metadata: Mapping[str, str]) -> ProblemSource | None:
    text = metadata.get("source")
    return None if text is None else ProblemSource(**json.loads(text))


def _digest(tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> str:
    """The sha256 (hex) of everything in the file but the digest itself."""
    digest = hashlib.sha256(json.dumps(metadata, sort_keys=True).encode())
    for name, tensor in sorted(tensors.items()):
        digest.update(f"{name} {tensor.dtype} {tensor.shape} ".encode())
        digest.update(tensor.tobytes())
    return digest.hexdigest()


def flatten(tree: Any, prefix: str) -> dict[str, np.ndarray]:
    """A tree of nested dictionaries as tensors, named by their paths after the prefix.

    Raises:
      ValueError: if a key is no string, or holds a slash.
    """
    if not isinstance(tree, Mapping):
        return {prefix: np.asarray(tree, order="C")}
    flat: dict[str, np.ndarray] = {}
    for key, value in tree.items():
        if not isinstance(key, str) or "/" in key:
            raise ValueError(f"cannot save a policy whose parameters are keyed by {key!r}")
        flat.update(flatten(value, f"{prefix}/{key}"))
    return flat


def unflatten(tensors: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The trees that `flatten` has made tensors of, by their prefixes."""
    trees: dict[str, Any] = {}
    for name, value in tensors.items():
        *parents, leaf = name.split("/")
        node = trees
        for parent in parents:
            node = node.setdefault(parent, {})
        node[leaf] = value
    return trees
