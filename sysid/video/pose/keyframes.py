"""The frames of a film that tell where the camera stands: each attitude a few times, the furthest most."""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.pose.view import View
from sysid.video.types import Rows

MAX_REPEATS = 4
"""Frames of a still picture that are used at most."""
MAX_KEYFRAMES = 150
"""Frames that are used at most to find what is unknown of the camera; the angle is found in all."""


@dataclass(frozen=True, slots=True)
class Keyframes:
    """The frames that tell where the camera stands, and how much each does."""

    rows: Rows
    share: Array
    """One over how many frames show the same still picture, shape (m,)."""
    speed: Array
    """Mean speed of the points [px/frame], shape (m,)."""


def keyframes_of(view: View, still: float) -> Keyframes:
    """Choose frames: few of those in which no point moves by more than `still` [px], many of those turned furthest."""
    whole = np.flatnonzero(np.isfinite(view.points).all(axis=(1, 2)))
    inner = whole[(whole > 0) & (whole < len(view.points) - 1)]  # one without neighbours shows no velocity
    rows = inner if len(inner) else whole
    runs: list[list[int]] = []
    for row in rows:
        if runs and np.abs(view.points[row] - view.points[runs[-1][0]]).max() <= still:
            runs[-1].append(int(row))
        else:
            runs.append([int(row)])
    kept = [
        (run[at], number)
        for number, run in enumerate(runs)
        for at in np.unique(np.linspace(0, len(run) - 1, min(len(run), MAX_REPEATS)).astype(int))
    ]
    rows, run = np.array(kept, np.intp).T
    if len(rows) > MAX_KEYFRAMES:
        away = _away(view.points[rows])
        far = np.argsort(-away)[: 2 * MAX_KEYFRAMES // 3]
        some = np.union1d(far, np.linspace(0, len(rows) - 1, MAX_KEYFRAMES // 3).astype(int))
        rows, run = rows[some], run[some]
    return Keyframes(rows, 1 / np.bincount(run)[run], point_speed(view)[rows])


def _away(points: Array) -> Array:
    """How far points in m frames [px], shape (m, N, 2), are turned from where they usually are; how far a single one is from there."""
    if points.shape[1] == 1:
        return np.linalg.norm(points[:, 0] - np.median(points[:, 0], axis=0), axis=1)
    turn = np.unwrap(np.angle((points[:, -1] - points[:, 0]) @ np.array([1, 1j])))
    return np.abs(turn - np.median(turn))


def point_speed(view: View) -> Array:
    """Mean speed of the points as filmed [px/frame], the larger one of before and after each frame, shape (n,)."""
    moved = np.linalg.norm(np.diff(view.track.points, axis=0), axis=-1).mean(axis=1)
    moved = np.pad(np.nan_to_num(moved).astype(np.float64), 1)
    return np.maximum(moved[1:], moved[:-1])
