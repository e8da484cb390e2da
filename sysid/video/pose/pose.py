"""Poses of a body in a picture: affine maps of places at home [px] to places there [px], shape (3, 3)."""

import numpy as np

from sysid.roll import Array


def shifted(by: Array) -> Array:
    """Return the pose that shifts by some [px], shape (2,)."""
    return np.array([[1.0, 0.0, by[0]], [0.0, 1.0, by[1]], [0.0, 0.0, 1.0]])


def turn_of(pose: Array) -> float:
    """Return the turn of a pose, shape (3, 3) [rad]."""
    return float(np.arctan2(pose[1, 0] - pose[0, 1], pose[0, 0] + pose[1, 1]))


def pose_between(home: Array, points: Array) -> Array | None:
    """Return the similarity from points (N, 2) [px] to others; None where fewer than two are seen in both."""
    both = np.isfinite(home + points).all(axis=1)
    if both.sum() < 2:
        return None
    one, other = (places[both] @ np.array([1, 1j]) for places in (home, points))
    arm = one - one.mean()
    turn = np.vdot(arm, other) / max(float(np.vdot(arm, arm).real), 1e-9)
    shift = other.mean() - turn * one.mean()
    return np.array([[turn.real, -turn.imag, shift.real], [turn.imag, turn.real, shift.imag], [0, 0, 1.0]])


def principal_corners(places: Array, weight: Array) -> tuple[Array, Array]:
    """Return four points, shape (4, 2), as wide apart as places (m, 2) [px] of some weights are on average, and how wide, (2,)."""
    middle = np.average(places, axis=0, weights=weight)
    variance, axes = np.linalg.eigh(np.cov((places - middle).T, aweights=weight))
    lengths = np.sqrt(np.maximum(variance, 0.0))
    return middle + (np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]) * lengths) @ axes.T, lengths


def attitude_share(turn: Array, step: float) -> Array:
    """Return one over how many of n frames show about the same attitude [1], shape (n,), by their turns and a step, of one unit.

    A film keeps what stands still as it is, its noise as well: many frames of one attitude count as one.
    """
    _, same, count = np.unique(np.round((turn - turn.min()) / step), return_inverse=True, return_counts=True)
    return 1 / count[same]
