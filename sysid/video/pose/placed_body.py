"""A body laid onto what some frames show, as a camera along the axis would see it."""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.pose.body import Body, first_body, turn_of
from sysid.video.pose.camera_state import DIFFERENCE_STEPS, CameraState
from sysid.video.pose.point_noise import MANY_POINTS, PointNoise, all_finite, near_ones, point_speed
from sysid.video.pose.rectify import enlargement, longer, rectify, unrectify
from sysid.video.pose.view import View
from sysid.video.types import Complex, Mask, Rows


@dataclass(frozen=True, slots=True)
class Found:
    """What all frames have in common."""

    camera_state: CameraState
    body: Body
    noise: PointNoise
    covariance: Array
    """Of Re c, Im c, Re q, Im q and the free unknowns of the camera, shape (4N + p, 4N + p)."""
    cost: float
    """Sum of squares that is left, weighed as usual noise would have it, and of what is known beforehand."""


@dataclass(frozen=True, slots=True)
class PlacedBody:
    """Some frames as a camera along the axis sees them, with a body laid onto them."""

    angle: Array
    rest: Complex
    """What does not fit [px, rectified], shape (m, N)."""
    turned: Complex
    slopes: Complex
    """Derivatives of the places by the free unknowns of the camera, shape (p, m, N)."""
    scale: Array
    """Pixels of the picture in one of the rectified one, shape (m,)."""


def fit_pose(
    points: Array,
    shear: Array,
    mask: Mask,
    matrix: Array,
    camera_state: CameraState,
    body: Body | None,
) -> tuple[PlacedBody, Body]:
    """Lay a body onto frames.

    Args:
        points: Points as a straight lens shows them [px], shape (m, N, 2).
        shear: What to add to them for each second of read-out [px/s], shape (m, N, 2).
        mask: Which are seen, shape (m, N).
        matrix: Camera matrix [px], shape (3, 3).
        camera_state: Direction, lens and read-out.
        body: The body; if None, the first one that the points suggest.

    Returns:
        The frames with the body, and the body.
    """
    yaw, pitch, logarithm, readout = camera_state.value
    camera = longer(matrix, logarithm)
    # In pixels, so that a longer lens alone changes nothing but the perspective.
    z = camera[0, 0] * rectify(np.where(mask[..., None], points + readout * shear, 0), camera, yaw, pitch)
    body = body or first_body(z, mask)
    angle, rest, turned = turn_of(z, mask, body)
    # Derivatives at the places without their noise: with it, noise would pass for a slant.
    clean = z - rest
    still = unrectify(clean / camera[0, 0], camera, yaw, pitch) - readout * shear
    slopes: list[Complex] = []
    for number in camera_state.free:
        moved = camera_state.value.copy()
        moved[number] += DIFFERENCE_STEPS[number]
        other = longer(matrix, moved[2])
        there = other[0, 0] * rectify(still + moved[3] * shear, other, moved[0], moved[1])
        slopes.append((there - clean) / DIFFERENCE_STEPS[number])
    middle = np.where(mask, clean, 0).sum(axis=1) / np.maximum(mask.sum(axis=1), 1)
    scale = 1 / enlargement(middle / camera[0, 0], yaw, pitch)
    return PlacedBody(angle, rest, turned, np.array(slopes).reshape(len(slopes), *z.shape), scale), body


def in_view(view: View, rows: Rows, matrix: Array, found: Found) -> tuple[PlacedBody, Mask]:
    """Lay the body that was found onto the frames `rows` (m,); also return which points took part, shape (m, N).

    `matrix` is the camera's [px], shape (3, 3).
    """
    points = view.points(rows)
    mask = all_finite(points)
    shear = view.shear(rows)
    seen, _ = fit_pose(points, shear, mask, matrix, found.camera_state, found.body)
    if mask.shape[1] >= MANY_POINTS:
        variance = found.noise.variance(point_speed(view, rows))
        for _ in range(3):  # many that slip turn the body at first, so that it takes more than one look
            mask = near_ones(mask, seen.rest * seen.scale[:, None], variance)
            seen, _ = fit_pose(points, shear, mask, matrix, found.camera_state, found.body)
    return seen, mask
