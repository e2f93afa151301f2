"""Opens the products that a linear program over the expected demand to come would sell."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linprog


class Product(NamedTuple):
    """Its legs, its fare, and its requests in a step at the start and at the end."""

    legs: tuple[str, ...]
    fare: float
    first: float
    last: float


LEGS = ("l1", "l2", "l3", "l4")
PRODUCTS = {
    "e1": Product(("l1",), 90.0, 1.8, 0.4),
    "b1": Product(("l1",), 240.0, 0.1, 1.1),
    "e3": Product(("l3",), 80.0, 1.6, 0.6),
    "b2": Product(("l2",), 260.0, 0.2, 1.6),
    "e13": Product(("l1", "l3"), 150.0, 1.6, 0.3),
    "b13": Product(("l1", "l3"), 420.0, 0.1, 1.0),
    "e24": Product(("l2", "l4"), 140.0, 2.4, 0.8),
    "b24": Product(("l2", "l4"), 380.0, 0.1, 1.0),
}
USES = np.array([[float(leg in product.legs) for product in PRODUCTS.values()] for leg in LEGS])
FARES = np.array([product.fare for product in PRODUCTS.values()])
HORIZON, MOST = 60, 0.5
"""Steps, and the share of its demand that an open product sells in the program."""


def demand(product: Product, step: int) -> float:
    """The expected requests of a product from a step on."""
    steps = np.arange(step, HORIZON)
    return (product.first + (product.last - product.first) * steps / HORIZON).sum()


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """The products that are open."""
    demands = [demand(product, step) for product in PRODUCTS.values()]
    seats = np.array([float(state[f"seats___{leg}"]) for leg in LEGS])
    bounds = [(0, most) for most in demands]
    sold = linprog(-FARES, A_ub=USES, b_ub=seats, bounds=bounds).x
    sales = zip(PRODUCTS, sold, demands, strict=True)
    return {f"accept___{name}": True for name, sale, most in sales if sale >= MOST * most}
