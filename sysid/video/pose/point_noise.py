"""Noise of points in pictures: at rest, in motion, and of those among many that have slipped."""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.pose.prior import POINT_FLOOR, BodyPrior
from sysid.video.pose.view import View
from sysid.video.types import Complex, Mask, Rows

BLUR_SHARE = 0.06
"""Distance from where they should be that is allowed to points in motion, as a share of their step from frame to frame."""
MANY_POINTS, OUTLIER_STDS = 8, 3.0
"""Of so many points those are left out that are so many standard deviations off."""


@dataclass(frozen=True, slots=True)
class PointNoise:
    """Variance of a point's place [px²], at rest and growing with the square of its speed."""

    rest: float
    blur: float

    def variance(self, speed: Array) -> Array:
        """Return the variance in each direction [px²] at a speed [px/frame], both of shape (n,)."""
        return self.rest + self.blur * speed**2


def point_noise(
    rest: Complex, mask: Mask, share: Array, speed: Array, unknowns: int, prior: BodyPrior
) -> tuple[PointNoise, Array]:
    """Find the noise, and how much each frame is to be believed, from 0 to 1.

    Args:
        rest: What does not fit [px], shape (m, N).
        mask: Which points are seen, shape (m, N).
        share: One over how many frames show the same still picture, shape (m,).
        speed: Mean speed of the points [px/frame], shape (m,).
        unknowns: How many numbers of the camera were found beside the body.
        prior: What is known of the body.
    """
    freedom = np.maximum(2 * mask.sum(axis=1) - 3, 1)
    square = (np.abs(rest) ** 2).sum(axis=1) / freedom
    typical = float(np.median(square)) + POINT_FLOOR**2 + (BLUR_SHARE * speed) ** 2
    doubt = 1 / (1 + square / (9 * typical)) ** 2
    weight = freedom * share
    spent = min(0.7, (4 * mask.shape[1] - 5 + unknowns) / float(weight.sum()))
    used = square < 25 * typical
    slow = used & (speed <= np.median(speed[used]))
    at_rest = float(np.average(square[slow], weights=weight[slow])) / (1 - spent) + prior.floor**2
    fast = used & (speed > 0.5)
    blur = 0.0
    if fast.sum() >= 3:
        moving = speed[fast]
        tells = weight[fast] * moving**2 / (at_rest + 1e-3 * moving**2) ** 2
        blur = float(max(np.sum(tells * (square[fast] - at_rest)) / np.sum(tells * moving**2), 0.0))
    return PointNoise(at_rest, blur), doubt


def near_ones(mask: Mask, rest: Complex, variance: Array) -> Mask:
    """Points that are about where the body has them: of many, some slip. The better half where most seem to.

    Args:
        mask: Which points are seen, shape (m, N), as the result.
        rest: What does not fit [px], shape (m, N).
        variance: Usual variance of a point's place in each direction [px²], shape (m,).
    """
    distance = np.where(mask, np.abs(rest), np.inf)
    near = mask & (distance < OUTLIER_STDS * np.sqrt(2 * variance)[:, None])
    count = mask.sum(axis=1)
    most = near.sum(axis=1) >= np.maximum(0.5 * count, MANY_POINTS)
    half = np.sort(distance, axis=1)[
        np.arange(len(count)), np.minimum(np.maximum(count // 2, MANY_POINTS), mask.shape[1] - 1)
    ]
    return np.asarray(np.where(most[:, None], near, mask & (distance <= half[:, None])), np.bool_)


def all_finite(points: Array) -> Mask:
    """Return which points (n, N, 2) [px] are seen, shape (n, N)."""
    return np.asarray(np.isfinite(points).all(axis=-1), np.bool_)


def enough_points(mask: Mask) -> Mask:
    """Return which frames (n,) show enough of the points for an angle, by which are seen (n, N); dimensionless."""
    return mask.sum(axis=1) >= max(2, min(mask.shape[1], 4) - 1)


def point_speed(view: View, rows: Rows) -> Array:
    """Mean speed of the points [px/frame], the larger one of before and after each frame, shape (m,)."""
    here = np.clip(rows[:, None] + np.arange(-1, 2), 0, len(view) - 1)
    with np.errstate(invalid="ignore"):
        moved = np.linalg.norm(np.diff(view.track.points[here], axis=1), axis=-1)
    count = np.isfinite(moved).sum(axis=2)
    return (np.nansum(moved, axis=2) / np.maximum(count, 1)).max(axis=1)
