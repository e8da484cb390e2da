"""The camera's own motion: a rotation, frame by frame, as the background shows it.

A camera that turns by R moves the ray r of every point to R r, whatever its depth. Patches of background give R by least squares
(Kabsch, 1976), weighed by how well each agrees.
"""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.types import Points

MIN_PATCHES = 4
"""Least number of patches: two show a rotation, and as many more whether they agree."""


@dataclass(frozen=True, slots=True)
class Shake:
    """Rotation of the camera against the first frame."""

    turn: Array
    """R of each frame, shape (n, 3, 3); the identity where the camera stands still."""
    std: Array
    """Standard deviation of the turn about the line of sight [rad], shape (n,)."""
    matrix: Array
    """Camera matrix [px], shape (3, 3)."""
    found: bool
    """Whether some background was followed, or the user says that the camera stands still."""

    @property
    def moves(self) -> bool:
        """Whether the camera moves."""
        return bool(np.any(self.turn != np.eye(3)))

    @property
    def size(self) -> float:
        """Standard deviation of the camera's rotation about the axis where it is largest [rad]."""
        return float(np.std(self.turn[:, [2, 0, 1], [1, 2, 0]], axis=0).max())

    def undo(self, points: Array) -> Array:
        """Return the points of all frames, shape (n, N, 2) [px], as a still camera shows them."""
        there = rays(points, self.matrix) @ self.turn @ self.matrix.T
        return there[..., :2] / there[..., 2:]


def rays(points: Array | Points, matrix: Array) -> Array:
    """Return the directions of points [px], shape (m, 2) or (n, m, 2), to a camera: of length 1, shape (m, 3) or (n, m, 3)."""
    ahead = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1) @ np.linalg.inv(matrix).T
    return ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)


def still(count: int, matrix: Array, *, found: bool = False) -> Shake:
    """Return the shake of a still camera with this matrix [px], shape (3, 3); `found` tells whether something shows it."""
    return Shake(np.tile(np.eye(3), (count, 1, 1)), np.zeros(count), matrix, found)


def find_shake(home: Points, seen: Points, matrix: Array) -> Shake:
    """Fit the camera's motion to patches of background, if it is likelier than none by the Bayesian information criterion.

    Args:
        home: Places of the patches in the first frame of the film [px], shape (m, 2).
        seen: Their places in n frames [px], shape (n, m, 2); NaN where one is not found.
        matrix: Camera matrix [px], shape (3, 3).
    """
    start, now, count = rays(home, matrix), rays(seen, matrix), len(seen)
    # A hundred frames at once take little longer than one, and little memory.
    parts = [fit_rotations(start, now[at : at + 100]) for at in range(0, count, 100)]
    turn, rest, spread = (np.concatenate(each) for each in zip(*parts, strict=True))
    good = np.isfinite(spread)
    # A patch is found to a hundredth of a pixel at best.
    floor = 0.01 / matrix[0, 0]
    scale, moved = (
        np.nanmedian(np.linalg.norm(one, axis=-1)) / np.sqrt(2 * np.log(2)) + floor
        for one in (rest, now - start)
    )
    gain = 2 * np.isfinite(rest[..., 0]).sum() * np.log(moved / scale)
    if gain < 3 * count * np.log(2 * len(home)) or good.sum() < count / 2:
        return still(count, matrix, found=True)
    # Frames without background take the motion of the last one that has some, with the scatter of all frames.
    last = np.maximum.accumulate(np.where(good, np.arange(count), int(np.argmax(good))))
    std = np.where(good, scale * np.sqrt(spread), np.std(turn[good, 1, 0]))
    return Shake(turn[last], std, matrix, True)


def fit_rotations(home: Array, seen: Array) -> tuple[Array, Array, Array]:
    """Fit the camera's rotation to each of n frames, ignoring patches that move on their own.

    Args:
        home: Rays of the patches in the first frame, shape (m, 3).
        seen: Their rays in n frames, shape (n, m, 3); NaN where one is not found.

    Returns:
        Rotations, shape (n, 3, 3), and residuals [rad], shape (n, m, 3). Variance of the turn about the line of sight for patches that are
        off by 1 rad, shape (n,). It is NaN if fewer than four patches agree.
    """
    found = np.isfinite(seen[..., 0])
    seen_any = found.any(axis=1, keepdims=True)
    place, weight = np.where(found[..., None], seen, home), found.astype(np.float64)
    turn = rest = np.zeros(0)
    for _ in range(8):  # weighed anew by how far each patch is off; converges by half or better each time
        left, _, right = np.linalg.svd(np.swapaxes(place * weight[..., None], 1, 2) @ home)
        left[..., -1] *= np.sign(np.linalg.det(left @ right))[:, None]
        turn = left @ right
        rest = place - home @ np.swapaxes(turn, 1, 2)
        off = np.where(found, np.linalg.norm(rest, axis=-1), np.where(seen_any, np.nan, 0.0))
        scale = np.nanmedian(off, axis=1) + 1e-5
        weight = found * np.nan_to_num(1 / (1 + (off / (3 * scale[:, None])) ** 2) ** 2)
    total = weight.sum(axis=1)
    middle = (weight @ home) / np.maximum(total, 1e-9)[:, None]
    about = (weight * ((home - middle[:, None])[..., :2] ** 2).sum(axis=-1)).sum(axis=1)
    enough = total > MIN_PATCHES - 1
    return (
        turn,
        np.where(found[..., None], rest, np.nan),
        np.where(enough, 1 / np.maximum(about, 1e-9), np.nan),
    )
