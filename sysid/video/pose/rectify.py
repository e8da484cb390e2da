"""Pictures as a camera along the board's axis would take them, and angles in them."""

import numpy as np

from sysid.roll import Array
from sysid.video.types import Complex


def rectify(points: Array, matrix: Array, yaw: float, pitch: float) -> Complex:
    """Return points (..., 2) [px] as a camera looking along the axis would see them, x + i y (y down).

    Args:
        points: Picture coordinates [px].
        matrix: Camera matrix [px], shape (3, 3).
        yaw: Direction of the axis, to the right of the line of sight [rad].
        pitch: Downwards [rad].
    """
    place = project(_look(yaw, pitch).T @ np.linalg.inv(matrix), points)
    return place[..., 0] + 1j * place[..., 1]


def unrectify(z: Complex, matrix: Array, yaw: float, pitch: float) -> Array:
    """Return where a camera that looks aside sees `z` (n, N), shape (n, N, 2) [px]: the inverse of `rectify`."""
    return project(matrix @ _look(yaw, pitch), np.stack([z.real, z.imag], axis=-1))


def upright(matrix: Array, yaw: float, pitch: float) -> Array:
    """Return `rectify` as a homography between pictures [px] of the same camera, then along the axis, shape (3, 3)."""
    return matrix @ _look(yaw, pitch).T @ np.linalg.inv(matrix)


def project(homography: Array, points: Array) -> Array:
    """Return where a homography, shape (3, 3), takes points (..., 2), as the result, to [its own unit]; NaN stays NaN."""
    there = points @ homography[:, :2].T + homography[:, 2]
    with np.errstate(invalid="ignore"):
        return there[..., :2] / there[..., 2:]


def enlargement(z: Complex, yaw: float, pitch: float) -> Array:
    """Return by how much rectifying enlarges areas at `z` [focal lengths], as a square root [1]; both of shape (n,).

    Noise of the picture grows with it, which must not count as a better or worse fit.
    """
    look = _look(yaw, pitch)
    return (look[2, 0] * z.real + look[2, 1] * z.imag + look[2, 2]) ** 1.5


def longer(matrix: Array, logarithm: float) -> Array:
    """Return a camera matrix [px], shape (3, 3), with its focal lengths scaled by exp(logarithm)."""
    scaled = matrix.copy()
    scaled[0, 0] *= np.exp(logarithm)
    scaled[1, 1] *= np.exp(logarithm)
    return scaled


def _look(yaw: float, pitch: float) -> Array:
    """Axes of the camera that looks along the axis, as columns, without a twist about it."""
    turn = np.hypot(yaw, pitch)
    if turn < 1e-12:
        return np.eye(3)
    # The axis is the optical axis turned to the right by yaw and down by pitch.
    vector = np.array([-pitch, yaw, 0.0]) / turn
    cross = np.array([[0, 0, vector[1]], [0, 0, -vector[0]], [-vector[1], vector[0], 0]])
    return np.eye(3) + np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross


def smear(angle: Array) -> Array:
    """What an unknown exposure does: a smeared body is seen at its mean, not at the middle of the exposure.

    The mean over an exposure T is off by φ̈ T²/24; for T anywhere between 0 and the frame interval the
    root mean square of that is the second difference of the angle over 54. Both are [rad], shape (n,).
    """
    smear = np.zeros(len(angle))
    with np.errstate(invalid="ignore"):
        smear[1:-1] = np.abs(np.diff(np.exp(1j * angle), n=2)) / 54
    return np.where(np.isfinite(smear), smear, 0.0)


def unwrap(angle: Array) -> Array:
    """Return angles [rad], shape (n,), without jumps of whole turns, past the NaN of frames that show nothing."""
    good = np.isfinite(angle)
    result = angle.copy()
    result[good] = np.unwrap(angle[good])
    return result
