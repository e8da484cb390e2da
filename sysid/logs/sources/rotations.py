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
    from scipy.spatial.transform import Rotation

    angle = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None]
    count = angle.shape[0]
    width = int(np.ceil(np.sqrt(count)))
    steps = np.tile(np.eye(3), (width * width, 1, 1))
    steps[:count] = Rotation.from_rotvec(angle).as_matrix()
    grid = steps.reshape(width, width, 3, 3)
    for column in range(1, width):
        grid[:, column] = grid[:, column - 1] @ grid[:, column]
    for row in range(1, width):
        grid[row] = grid[row - 1, -1] @ grid[row]
    return np.concatenate((np.eye(3)[None], grid.reshape(-1, 3, 3)[:count]))


def cross_matrices(vector: Array) -> Array:
    """Return [v]× with [v]× w = v × w for vectors of shape (n, 3), shape (n, 3, 3)."""
    matrix = np.zeros((*vector.shape, 3))
    for row, column, index, sign in ((0, 1, 2, -1), (0, 2, 1, 1), (1, 2, 0, -1)):
        matrix[..., row, column] = sign * vector[..., index]
        matrix[..., column, row] = -sign * vector[..., index]
    return matrix
