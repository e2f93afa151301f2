"""The values of an action fluent's features, and sums of them, in few and small operations.

Searches play many policies side by side, with a few rollouts of each. A product of matrices for
each feature and policy would take about a microsecond each on a CPU, more than what it computes:
with those, rollouts of rules last up to four times as long (`results/part_times`, 070e70f).
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mdpo_rddl.planner.plans.features import Feature, array_module


def feature_values(
    features: Sequence[Feature], scaled: Mapping[str, Any], replicas: tuple[int, ...] = ()
) -> list[Any]:
    """The value of each feature, one per object, an array that broadcasts to the action's shape.

    Fluents with the same neighbours are side by side in one product with the means of all of them.

    Args:
      features: of an action fluent.
      scaled: per fluent its value [*its shape, *replicas].
      replicas: how many there are, (B,), if they are an axis of the arrays.
    """
    averaged: dict[tuple[str, int], Any] = {}
    for fluents, means in _with_same_means(features):
        ends = np.cumsum([len(each) for each in means])
        xp = array_module(scaled[fluents[0]])
        matrix = np.concatenate(means)
        sizes = (matrix.shape[1], *replicas)
        flat = xp.stack([xp.reshape(scaled[fluent], sizes) for fluent in fluents])
        if replicas:
            product = xp.asarray(matrix, flat.dtype) @ flat
        else:
            product = flat @ xp.asarray(matrix.T, flat.dtype)
        for fluent, row in zip(fluents, product, strict=True):
            for each, part in zip(means, xp.split(row, ends[:-1]), strict=True):
                averaged[fluent, id(each)] = part
    return [
        feature.lay(averaged.get((feature.fluent, id(feature.means)), scaled[feature.fluent]))
        for feature in features
    ]


def weighted_sum(weights: Any, values: Sequence[Any]) -> Any:
    """The sum of values [*shape] times their weights [number of values].

    Those that depend on the same axes are summed first, the smallest sums before others.
    """
    sums: dict[tuple[int, ...], Any] = {}
    for number, value in enumerate(values):
        shape, term = np.shape(value), weights[number] * value
        sums[shape] = sums[shape] + term if shape in sums else term
    parts = sorted(sums.values(), key=lambda part: math.prod(part.shape))
    return sum(parts[1:], start=parts[0])


def _with_same_means(features: Sequence[Feature]) -> list[tuple[list[str], list[np.ndarray]]]:
    """Fluents whose means are taken over the same neighbours, and what takes them."""
    means: dict[str, dict[int, np.ndarray]] = {}
    for feature in features:
        if feature.means is not None:
            means.setdefault(feature.fluent, {})[id(feature.means)] = feature.means
    groups: dict[tuple[int, ...], list[str]] = {}
    for fluent, own in means.items():
        groups.setdefault(tuple(own), []).append(fluent)
    return [(fluents, [*means[fluents[0]].values()]) for fluents in groups.values()]
