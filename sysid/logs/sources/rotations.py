"""Rotations of many samples at once."""

import numpy as np

from sysid.roll import Array


def integrate_rate(time: Array, rate: Array) -> Array:
    """Return the rotation from the sensor's frame to its frame at the first sample, shape (n, 3, 3).

    Each step turns by the mean of the rates at its ends. The running product is taken within rows of about
    √n steps at once for all rows, and then along the rows.

    Args:
        time: Time [s], shape (n,).
        rate: Rotation rates in the sensor's frame [rad/s], shape (n, 3).
    """
    angle = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None]
    count = angle.shape[0]
    width = int(np.ceil(np.sqrt(count)))
    steps = np.tile(np.eye(3), (width * width, 1, 1))
    steps[:count] = rotation_matrices(angle)
    grid = steps.reshape(width, width, 3, 3)
    for column in range(1, width):
        grid[:, column] = grid[:, column - 1] @ grid[:, column]
    for row in range(1, width):
        grid[row] = grid[row - 1, -1] @ grid[row]
    return np.concatenate((np.eye(3)[None], grid.reshape(-1, 3, 3)[:count]))


def rotation_matrices(angle: Array) -> Array:
    """Return the rotations by vectors of angle [rad], shape (n, 3), as matrices (Rodrigues), shape (n, 3, 3)."""
    squared = np.einsum("ni,ni->n", angle, angle)
    size = np.sqrt(squared)
    near = size < 1e-6
    safe = np.where(near, 1.0, size)
    sine = np.where(near, 1.0 - squared / 6, np.sin(safe) / safe)
    cosine = np.where(near, 0.5 - squared / 24, (1 - np.cos(safe)) / safe**2)
    skew = cross_matrices(angle)
    return np.eye(3) + sine[:, None, None] * skew + cosine[:, None, None] * (skew @ skew)


def cross_matrices(vector: Array) -> Array:
    """Return [v]× with [v]× w = v × w for vectors of shape (n, 3), shape (n, 3, 3)."""
    matrix = np.zeros((*vector.shape, 3))
    for row, column, index, sign in ((0, 1, 2, -1), (0, 2, 1, 1), (1, 2, 0, -1)):
        matrix[..., row, column] = sign * vector[..., index]
        matrix[..., column, row] = -sign * vector[..., index]
    return matrix


def quaternion_matrices(quaternion: Array) -> Array:
    """Return the rotations of quaternions w, x, y, z of any length (dimensionless), shape (n, 4), as matrices, shape (n, 3, 3)."""
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def rotation_angles(matrices: Array) -> Array:
    """Return the vectors of angle [rad], shape (n, 3), of rotations by less than half a turn, shape (n, 3, 3)."""
    skew = np.stack(
        (
            matrices[:, 2, 1] - matrices[:, 1, 2],
            matrices[:, 0, 2] - matrices[:, 2, 0],
            matrices[:, 1, 0] - matrices[:, 0, 1],
        ),
        axis=1,
    )
    sine = np.linalg.norm(skew, axis=1) / 2
    angle = np.arctan2(sine, (np.trace(matrices, axis1=1, axis2=2) - 1) / 2)
    return skew / 2 * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)[:, None]
