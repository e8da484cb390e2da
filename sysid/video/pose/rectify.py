"""Maps between pictures [px], shape (3, 3): homographies to a camera along the board's axis, and poses, affine maps from places at home."""

import numpy as np

from sysid.roll import Array
from sysid.video.types import Complex


def upright(matrix: Array, camera: Array) -> Array:
    """Return the homographies, shape (..., 3, 3) [px], to pictures of the same level camera that looks along the axis.

    Args:
        matrix: Camera matrix [px], shape (3, 3).
        camera: Shape (..., 3) or longer. Yaw and pitch of the axis to the right of and down from the line of sight [rad]. Then the
        logarithm of the focal length over that of the matrix.
    """
    yaw, pitch, longer = (camera[..., number] for number in range(3))
    scaled = matrix * np.where(np.diag([1.0, 1.0, 0.0]) > 0, np.exp(longer)[..., None, None], 1.0)
    turn = np.hypot(yaw, pitch)
    away = np.sinc(turn / np.pi)
    x, y, z = away * yaw, away * pitch, np.cos(turn)
    level = np.hypot(y, z)
    # The axis is level, and so are both cameras: no turn about it, nor about the line of sight, is left open.
    look = np.array([[level, -x * y / level, -x * z / level], [0 * x, z / level, -y / level], [x, y, z]])
    return scaled @ np.moveaxis(look, (0, 1), (-2, -1)) @ np.linalg.inv(scaled)


def rectify(points: Array, matrix: Array, camera: Array) -> Complex:
    """Return points [px], shape (n, 2) or (m, n, 2), to a camera along the axis, x + i y (y down); arguments as of `upright`."""
    place = project(upright(matrix, camera), points)
    return place[..., 0] + 1j * place[..., 1]


def project(homography: Array, points: Array) -> Array:
    """Return where homographies, shape (..., 3, 3), take points, shape (n, 2) or (m, n, 2), to [their own unit]; NaN stays NaN."""
    # Long rows: half the time.
    there = homography[..., :2] @ np.swapaxes(points, -1, -2) + homography[..., 2:]
    with np.errstate(invalid="ignore"):
        return np.swapaxes(there[..., :2, :] / there[..., 2:, :], -1, -2)


def smear(angle: Array) -> Array:
    """Return the error of an unknown exposure: a smeared body is seen at its mean, not at the middle of the exposure.

    The mean over an exposure T is off by φ̈ T²/24. With T anywhere up to the frame interval, its root mean square is the second
    difference of the angle over 54. Both are [rad], shape (n,).
    """
    smear = np.zeros(len(angle))
    with np.errstate(invalid="ignore"):
        smear[1:-1] = np.abs(np.diff(np.exp(1j * angle), n=2)) / 54
    return np.nan_to_num(smear)


def unwrap(angle: Array) -> Array:
    """Return angles [rad], shape (n,), without jumps of whole turns, past the NaN of frames that show nothing."""
    good = np.isfinite(angle)
    result = angle.copy()
    result[good] = np.unwrap(angle[good])
    return result


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
