"""Whether tensors that were read are those of a planner."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


def fitted(name: str, saved: np.ndarray, shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """The tensor, if it has this shape and type.

    Raises:
      ValueError: naming it, if it has not.
    """
    if saved.shape != shape or saved.dtype != dtype:
        found, wanted = f"{saved.dtype}{list(saved.shape)}", f"{np.dtype(dtype)}{list(shape)}"
        raise ValueError(f"its {name} is {found} where the planner has {wanted}")
    return saved


def fitted_leaves(
    name: str, tensors: dict[str, np.ndarray], template: Any, lanes: int | None = None
) -> list[np.ndarray]:
    """The leaves of a tree that were saved as "name/0", "name/1" and so on.

    Args:
      name: of the tree.
      tensors: by their names.
      template: a tree of the leaves' shapes and types.
      lanes: length of an axis that the leaves have before these; none if None.

    Raises:
      KeyError: if a leaf is missing.
      ValueError: if there is one too many, or one of another shape or type.
    """
    leaves = jax.tree.leaves(template)
    if f"{name}/{len(leaves)}" in tensors:
        raise ValueError(f"its {name} have more parts than the planner's")
    axis = () if lanes is None else (lanes,)
    return [
        fitted(f"{name}/{i}", tensors[f"{name}/{i}"], axis + np.shape(leaf), jnp.result_type(leaf))
        for i, leaf in enumerate(leaves)
    ]
