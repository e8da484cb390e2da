"""Quaternions (w, x, y, z) of unit length, for NumPy arrays and torch tensors alike."""

from typing import Any

from sim.skate.arrays import namespace


def multiply(first: Any, second: Any) -> Any:
    """Return the rotation `second` followed by `first`, shape (..., 4); both broadcast."""
    xp = namespace(first)
    scalar, vector = first[..., :1], first[..., 1:]
    scalar_2, vector_2 = second[..., :1], second[..., 1:]
    return xp.concatenate(
        (
            scalar * scalar_2 - (vector * vector_2).sum(axis=-1)[..., None],
            scalar * vector_2 + scalar_2 * vector + _cross(vector, vector_2),
        ),
        axis=-1,
    )


def conjugate(quaternion: Any) -> Any:
    """Return the inverse rotation, shape (..., 4)."""
    return namespace(quaternion).concatenate((quaternion[..., :1], -quaternion[..., 1:]), axis=-1)


def rotate(quaternion: Any, vector: Any) -> Any:
    """Return vectors, shape (..., 3), turned by rotations, shape (..., 4); both broadcast."""
    axis = quaternion[..., 1:]
    twice = 2 * _cross(axis, vector)
    return vector + quaternion[..., :1] * twice + _cross(axis, twice)


def rotate_back(quaternion: Any, vector: Any) -> Any:
    """Return vectors of the outer frame expressed in the rotated frame, shape (..., 3); both broadcast."""
    axis = quaternion[..., 1:]
    twice = 2 * _cross(axis, vector)
    return vector - quaternion[..., :1] * twice + _cross(axis, twice)


def yaw(quaternion: Any) -> Any:
    """Return the heading of the rotated x axis about the vertical [rad], shape (...,)."""
    w, x, y, z = (quaternion[..., i] for i in range(4))
    return namespace(quaternion).arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def angle_between(first: Any, second: Any) -> Any:
    """Return the angle of the rotation from one orientation to another [rad] in [0, π], shape (...,)."""
    xp = namespace(first)
    difference = multiply(conjugate(first), second)
    sine = xp.sqrt((difference[..., 1:] ** 2).sum(axis=-1))
    return 2 * xp.arctan2(sine, xp.abs(difference[..., 0]))


def slerp(start: Any, end: Any, fraction: Any) -> Any:
    """Turn from `start` to `end` along the shorter arc at constant rate (Shoemake 1985), shape (..., 4).

    Args:
        start: Orientations at fraction 0, shape (..., 4).
        end: Orientations at fraction 1, shape (..., 4).
        fraction: Way gone in [0, 1], broadcast against shape (...).
    """
    xp = namespace(start)
    cosine = (start * end).sum(axis=-1)
    end = xp.where((cosine < 0)[..., None], -end, end)
    cosine = xp.clip(xp.abs(cosine), 0.0, 1.0)
    angle = xp.arccos(cosine)
    sine = xp.sin(angle)
    near = sine < 1e-5  # there both weights are 0/0; a straight line is exact to rounding
    safe = xp.where(near, xp.ones_like(sine), sine)
    start_weight = xp.where(near, 1 - fraction + 0 * sine, xp.sin((1 - fraction) * angle) / safe)
    end_weight = xp.where(near, fraction + 0 * sine, xp.sin(fraction * angle) / safe)
    turned = start_weight[..., None] * start + end_weight[..., None] * end
    return turned / xp.sqrt((turned**2).sum(axis=-1))[..., None]


def _cross(first: Any, second: Any) -> Any:
    """Return the cross product; torch broadcasts only arrays of equally many axes."""
    if first.ndim != second.ndim:
        ndim = max(first.ndim, second.ndim)
        first, second = (vector[(None,) * (ndim - vector.ndim)] for vector in (first, second))
    return namespace(first).linalg.cross(first, second)
