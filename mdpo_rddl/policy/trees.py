"""Trees of parameters as tensors with names, as files hold them."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

_MOST_PARTS = 64
_PART = re.compile(r"\[[0-9]+\]")


def flatten(tree: Any, prefix: str) -> dict[str, np.ndarray]:
    """A tree of nested dictionaries and tuples as tensors, named by their paths after the prefix.

    The parts of a tuple are named by their numbers in brackets. What is empty leaves nothing.

    Raises:
      ValueError: if a key is no string, holds a slash, or is a number in brackets.
    """
    if isinstance(tree, tuple):
        parts = {f"{prefix}/[{number}]": part for number, part in enumerate(tree)}
        return {
            name: leaf for at, part in parts.items() for name, leaf in flatten(part, at).items()
        }
    if not isinstance(tree, Mapping):
        return {prefix: np.asarray(tree, order="C")}
    flat: dict[str, np.ndarray] = {}
    for key, value in tree.items():
        if not isinstance(key, str) or "/" in key or _PART.fullmatch(key):
            raise ValueError(f"cannot save a policy whose parameters are keyed by {key!r}")
        flat.update(flatten(value, f"{prefix}/{key}"))
    return flat


def unflatten(tensors: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The trees that `flatten` has made tensors of, by their prefixes.

    Raises:
      ValueError: if one is deeper than what recursive functions and messages can hold, or a part
        of a tuple is missing.
    """
    trees: dict[str, Any] = {}
    for name, value in tensors.items():
        if name.count("/") >= _MOST_PARTS:
            raise ValueError(f"its tensor {name:.40}... has more than {_MOST_PARTS} parts")
        *parents, leaf = name.split("/")
        node = trees
        for parent in parents:
            node = node.setdefault(parent, {})
        node[leaf] = value
    return {name: _with_tuples(tree) for name, tree in trees.items()}


def _with_tuples(tree: Any) -> Any:
    """The tree, of whose dictionaries those that stand for tuples are some."""
    if not isinstance(tree, dict):
        return tree
    parts = {key: _with_tuples(value) for key, value in tree.items()}
    if not any(map(_PART.fullmatch, parts)):
        return parts
    names = [f"[{number}]" for number in range(len(parts))]
    if parts.keys() != set(names):
        raise ValueError(f"its {min(parts):.40} is a part of no tuple")
    return tuple(parts[name] for name in names)
