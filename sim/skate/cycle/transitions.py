"""Mounting and dismounting: the path of the key bodies from one pose to the other.

The path leads from the bodies' places at the begin of the transition to the canonical pose of the next phase. In the frame of
the board, positions follow Bézier curves and orientations slerp (HUSKY, section III-D).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sim.skate.arrays import namespace
from sim.skate.rotation import slerp

KEY_BODIES = (
    "pelvis",
    *(f"{side}_{link}_link" for side in ("left", "right") for link in ("hip_roll", "knee", "ankle_roll")),
    "torso_link",
    *(
        f"{side}_{link}_link"
        for side in ("left", "right")
        for link in ("shoulder_roll", "elbow", "wrist_yaw")
    ),
)
"""The 14 bodies that are guided, in the order of all arrays about them."""


def bezier(points: Sequence[Any], fraction: Any) -> Any:
    """Return the point of a Bézier curve of order len(points) - 1.

    Args:
        points: Control points from start to end, each of shape (..., 3).
        fraction: Parameter in [0, 1], broadcast against shape (...).
    """
    order = len(points) - 1
    weights = [math.comb(order, i) * (1 - fraction) ** (order - i) * fraction**i for i in range(order + 1)]
    return sum(weight[..., None] * point for weight, point in zip(weights, points, strict=True))


@dataclass(frozen=True, slots=True)
class TransitionPath:
    """The family of curves: order and lift."""

    order: int = 2
    """Order of the Bézier curves; 1 is a straight line."""
    lift: float = 0.2
    """Height of the inner control points above the straight line [m]; a quadratic peaks at half of it."""

    def positions(self, start: Any, end: Any, fraction: Any, lifted: Any) -> Any:
        """Return target positions.

        Args:
            start: Positions at the beginning of the transition [m], shape (..., bodies, 3).
            end: Canonical positions [m], shape (bodies, 3) or (..., bodies, 3).
            fraction: Way gone in [0, 1], shape (...,).
            lifted: How much of the lift each body gets, shape (bodies,) or (..., bodies): 1 for what
                swings, 0 for what stands.

        Returns:
            Positions [m], shape (..., bodies, 3).
        """
        xp = namespace(start)
        up = xp.zeros_like(start)
        up[..., 2] = self.lift * lifted
        points = [start + (end - start) * (i / self.order) for i in range(self.order + 1)]
        points[1:-1] = [point + up for point in points[1:-1]]
        return bezier(points, fraction[..., None])

    def orientations(self, start: Any, end: Any, fraction: Any) -> Any:
        """Return target orientations, shape (..., bodies, 4), from quaternions of the same shapes."""
        return slerp(start, end + 0 * start, fraction[..., None])
