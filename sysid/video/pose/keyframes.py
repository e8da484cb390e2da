"""The frames of a film that tell where the camera stands, and the noise of points in them, at rest and in motion."""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.pose.prior import POINT_FLOOR, BodyPrior
from sysid.video.pose.rectify import attitude_share
from sysid.video.pose.view import View
from sysid.video.types import Rows

MAX_KEYFRAMES = 150
"""Most frames that are used to fit the camera; the angle is found in all."""
BLUR_SHARE = 0.06
"""Distance from where they should be that is allowed to points in motion, as a share of their step from frame to frame."""


@dataclass(frozen=True, slots=True)
class Keyframes:
    """The frames that tell where the camera stands, and how much each does."""

    rows: Rows
    share: Array
    """One over how many of them show the same attitude, shape (m,)."""
    speed: Array
    """Mean speed of the points [px/frame], shape (m,)."""


def keyframes_of(view: View, still: float) -> Keyframes:
    """Choose frames, many of those turned furthest; those in which the points are the same to within `still` [px] count as one."""
    whole = np.flatnonzero(np.isfinite(view.points).all(axis=(1, 2)))
    inner = whole[(whole > 0) & (whole < len(view.points) - 1)]  # one without neighbours shows no velocity
    rows = inner if len(inner) else whole
    went = _went(view.points[rows])
    if len(rows) > MAX_KEYFRAMES:
        far = np.argsort(-np.abs(went - np.median(went)))[: 2 * MAX_KEYFRAMES // 3]
        some = np.union1d(far, np.linspace(0, len(rows) - 1, MAX_KEYFRAMES // 3).astype(int))
        rows, went = rows[some], went[some]
    return Keyframes(rows, attitude_share(went, still), point_speed(view)[rows])


def _went(points: Array) -> Array:
    """How far the last of some points, shape (m, N, 2), has turned about the first one, or a single one has gone, shape (m,) [px]."""
    if points.shape[1] == 1:
        return np.linalg.norm(points[:, 0] - np.median(points[:, 0], axis=0), axis=1)
    arm = (points[:, -1] - points[:, 0]) @ np.array([1, 1j])
    return float(np.median(np.abs(arm))) * np.unwrap(np.angle(arm))


def point_speed(view: View) -> Array:
    """Mean speed of the points as filmed [px/frame], the larger one of before and after each frame, shape (n,)."""
    moved = np.linalg.norm(np.diff(view.track.points, axis=0), axis=-1).mean(axis=1)
    moved = np.pad(np.nan_to_num(moved).astype(np.float64), 1)
    return np.maximum(moved[1:], moved[:-1])


@dataclass(frozen=True, slots=True)
class PointNoise:
    """Variance of a point's place [px²], at rest and growing with the square of its speed."""

    rest: float
    blur: float

    def variance(self, speed: Array) -> Array:
        """Return the variance in each direction [px²] at a speed [px/frame], both of shape (n,)."""
        return self.rest + self.blur * speed**2


def point_noise(rest: Array, some: Keyframes, unknowns: int, prior: BodyPrior) -> tuple[PointNoise, Array]:
    """Find the noise by residuals (m, N, 2) [px] of a body and some unknowns of the camera, and how much to believe each frame [1]."""
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
