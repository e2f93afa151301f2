"""Optimisers that optax has the parts of."""

import optax


def normalized_adam(
    learning_rate: float, b1: float = 0.9, b2: float = 0.999
) -> optax.GradientTransformation:
    """Adam on gradients of norm 1.

    A relaxed model's gradient can be a thousand times its usual size for a single iteration; its
    direction is worth a step, its size is not worth a thousand in Adam's second moment. What is
    not a number counts as zero.

    Args:
      learning_rate: the step size.
      b1, b2: decays of Adam's first and second moment.
    """
    return optax.chain(
        optax.normalize_by_update_norm(),
        optax.zero_nans(),
        optax.adam(learning_rate, b1=b1, b2=b2),
    )
