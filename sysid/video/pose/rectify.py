"""Pictures as a camera along the board's axis would take them, and angles in them."""

import numpy as np

from sysid.roll import Array
from sysid.video.types import Complex


def upright(matrix: Array, camera: Array) -> Array:
    """Return the homographies, shape (..., 3, 3) [px], to pictures of the same level camera that looks along the axis.

    Args:
        matrix: Camera matrix [px], shape (3, 3).
        camera: Yaw and pitch of the axis [rad], to the right of and down from the line of sight; logarithm of the focal length over that
        of the matrix. Shape (..., 3) or longer.
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
