"""A cascade: a speed from the position, an acceleration from the speed, a tilt from that."""

from collections.abc import Mapping
from math import atan2, cos, sqrt
from typing import Any

GRAVITY, MAX_THRUST, MAX_TORQUE = 1.62, 4.0, 0.5
ACROSS, MAX_ACROSS = 0.12, 7.0
"""Speed across per unit of distance, and its limit."""
GAIN_ACROSS, GAIN_DOWN = 0.4, 1.2
"""Acceleration per unit of speed that is wrong."""
BRAKE, MAX_DOWN, TOUCH_DOWN = 0.4, 6.0, 0.9
"""Deceleration before the ground, and speeds down: added to the last at most, and at the ground."""
NEAR, FAR_HEIGHT, FAR_DOWN = 3.0, 30.0, 0.12
"""Distance from the pad; height and speed per unit of height where it is farther than that."""
GATE, CALM_ACROSS, CALM_TILT = 7.0, 0.75, 0.25
"""Height at which it stays until it moves and tilts no more than that."""
LEAST_UP = 0.8
TILT, LOW_TILT, LOW = 0.5, 0.15, 2.0
"""Largest tilt, and the one below the height LOW."""
GAIN_TILT, GAIN_SPIN = 2.5, 2.5


def clipped(value: float, limit: float) -> float:
    """A value between -limit and limit."""
    return max(-limit, min(limit, value))


def speed_up(state: Mapping[str, Any]) -> float:
    """The wanted speed up: negative, and such that braking ends at the ground."""
    x, y = state["x"], state["y"]
    wanted = -(TOUCH_DOWN + min(MAX_DOWN, sqrt(2 * BRAKE * max(0.0, y - 1.0))))
    far = max(0.0, abs(x) - NEAR)
    if y < FAR_HEIGHT and far > 0:
        wanted = max(wanted, -FAR_DOWN * y / (1 + 0.15 * far))
    is_calm = abs(state["vx"]) <= CALM_ACROSS and abs(state["theta"]) <= CALM_TILT
    return wanted if y >= GATE or is_calm else max(wanted, 0.0)


def rule(state: Mapping[str, Any], step: int) -> dict[str, Any]:
    """Thrust and torque."""
    theta = state["theta"]
    across = clipped(-ACROSS * state["x"], MAX_ACROSS)
    push = GAIN_ACROSS * (across - state["vx"]) - state["wind"]
    up = max(LEAST_UP, GRAVITY + GAIN_DOWN * (speed_up(state) - state["vy"]))
    tilt = clipped(atan2(push, up), TILT if state["y"] > LOW else LOW_TILT)
    torque = GAIN_TILT * (tilt - theta) - GAIN_SPIN * state["omega"]
    return {
        "thrust": float(min(MAX_THRUST, up / max(0.3, cos(theta)))),
        "torque": float(clipped(torque, MAX_TORQUE)),
    }
