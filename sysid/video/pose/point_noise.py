"""Noise of points in pictures, at rest and in motion."""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.pose.keyframes import Keyframes
from sysid.video.pose.prior import POINT_FLOOR, BodyPrior

BLUR_SHARE = 0.06
"""Distance from where they should be that is allowed to points in motion, as a share of their step from frame to frame."""


@dataclass(frozen=True, slots=True)
class PointNoise:
    """Variance of a point's place [px²], at rest and growing with the square of its speed."""

    rest: float
    blur: float

    def variance(self, speed: Array) -> Array:
        """Return the variance in each direction [px²] at a speed [px/frame], both of shape (n,)."""
        return self.rest + self.blur * speed**2


def point_noise(rest: Array, some: Keyframes, unknowns: int, prior: BodyPrior) -> tuple[PointNoise, Array]:
    """Find the noise, and how much each frame is to be believed, from 0 to 1.

    Args:
        rest: Residuals [px], shape (m, N, 2).
        some: The frames.
        unknowns: How many numbers of the camera were found beside the body.
        prior: Prior knowledge of the body.
    """
    speed, points = some.speed, rest.shape[1]
    freedom = max(2 * points - 3, 1)
    square = (rest**2).sum(axis=(1, 2)) / freedom
    typical = float(np.median(square)) + POINT_FLOOR**2 + (BLUR_SHARE * speed) ** 2
    doubt = 1 / (1 + square / (9 * typical)) ** 2
    spent = min(0.7, (4 * points - 5 + unknowns) / float(freedom * some.share.sum()))
    used = square < 25 * typical
    slow = used & (speed <= np.median(speed[used]))
    at_rest = float(np.average(square[slow], weights=some.share[slow])) / (1 - spent) + prior.floor**2
    fast = used & (speed > 0.5)
    blur = 0.0
    if fast.sum() >= 3:
        moving = speed[fast]
        tells = some.share[fast] * moving**2 / (at_rest + 1e-3 * moving**2) ** 2
        blur = float(max(np.sum(tells * (square[fast] - at_rest)) / np.sum(tells * moving**2), 0.0))
    return PointNoise(at_rest, blur), doubt
