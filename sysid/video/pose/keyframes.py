"""The frames of a film that tell where the camera stands: each attitude a few times, the furthest most."""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.pose.point_noise import MANY_POINTS, all_finite, enough_points, point_speed
from sysid.video.pose.view import View
from sysid.video.types import Mask, Rows

MAX_REPEATS = 4
"""Frames of a still picture that are used at most."""
MAX_KEYFRAMES = 200
"""Frames that are used at most to find what is unknown of the camera; the angle is found in all."""


@dataclass(frozen=True, slots=True)
class Keyframes:
    """The frames that tell where the camera stands, and how much each does."""

    rows: Rows
    mask: Mask
    share: Array
    """One over how many frames show the same still picture, shape (m,)."""
    speed: Array
    """Mean speed of the points [px/frame], shape (m,)."""


def keyframes_of(view: View, still: float) -> Keyframes:
    """Choose frames: few of those that show one and the same picture, many of those turned furthest."""
    run = np.zeros(len(view), int)
    anchor, number = np.full(view.track.points.shape[1:], np.inf), 0
    # Freed of the camera's shake: what a lens, a shade or a slant does to a point goes with the body's attitude.
    steady = np.concatenate([view.points(rows) for rows in view.chunks()])
    for row in range(len(view)):
        points = steady[row]
        with np.errstate(invalid="ignore"):
            away = np.abs(points - anchor)
        known = np.isfinite(away)
        # Of many points some slip: the picture is another one if half of them have moved.
        moved = np.median if len(points) >= MANY_POINTS else np.max
        if not known.any() or moved(away[known]) > still:
            anchor, number = points, number + 1
        run[row] = number
    usable = np.flatnonzero(enough_points(all_finite(steady)))
    if len(usable) > 2:  # a frame without neighbours shows no velocity
        usable = usable[(usable > 0) & (usable < len(view) - 1)]
    _, first, count = np.unique(run[usable], return_index=True, return_counts=True)
    kept = np.concatenate(
        [
            usable[begin + np.unique(np.linspace(0, many - 1, min(many, MAX_REPEATS)).astype(int))]
            for begin, many in zip(first, count, strict=True)
        ]
    )
    if len(kept) > MAX_KEYFRAMES:
        ends = np.array([points[all_finite(points)][[0, -1]] for points in steady[kept]])
        direction = np.angle((ends[:, 1] - ends[:, 0]) @ np.array([1, 1j]))
        away = np.abs(np.angle(np.exp(1j * (direction - np.median(direction)))))
        far = np.argsort(-away)[: 2 * MAX_KEYFRAMES // 3]
        even = np.linspace(0, len(kept) - 1, MAX_KEYFRAMES // 3).astype(int)
        kept = kept[np.unique(np.concatenate([far, even]))]
    _, inverse, count = np.unique(run[kept], return_inverse=True, return_counts=True)
    return Keyframes(kept, all_finite(view.points(kept)), 1 / count[inverse], point_speed(view, kept))
