"""The angle of a body that turns about an axis, from points in pictures.

A camera that does not look along the axis sees circles as ellipses, and at more depth than one. The
picture that it would take if it did look along it is a homography of its own, known up to the axis'
direction and the focal length; in that picture points run on circles (`body`). Direction, focal
length and read-out of the shutter are what makes the circles round, with what is known beforehand.
"""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.pose.angle_uncertainty import common_variance, left_out, slant_ambiguity
from sysid.video.pose.camera_state import CameraState
from sysid.video.pose.circles import fit_circles
from sysid.video.pose.keyframes import keyframes_of
from sysid.video.pose.placed_body import in_view
from sysid.video.pose.point_noise import BLUR_SHARE, enough_points, point_speed
from sysid.video.pose.prior import POINT_FLOOR, BodyPrior
from sysid.video.pose.rectify import smear, unwrap
from sysid.video.pose.view import View
from sysid.video.types import Complex


@dataclass(frozen=True, slots=True)
class AngleTrack:
    """How a body turned, as seen by the camera."""

    angle: Array
    """Angle about the axis, clockwise in the picture [rad], shape (n,), unwrapped; NaN where not seen."""
    std: Array
    """Standard deviation of each angle [rad], shape (n,): noise, blur and what is unknown of the camera;
    not a common offset."""
    camera_state: CameraState
    """What was found of direction, lens and shutter."""
    noise: float
    """Standard deviation of a point's position at rest [px]."""
    outliers: int
    """Frames left out because their points do not fit a turning body."""
    shape: Complex
    """The body's points at angle zero, as a camera along the axis sees them, about their middle."""
    own: Array | None = None
    """Share of `std` that is not common to all frames [rad], shape (n,); all of it if None."""


def fit_angle(view: View, matrix: Array, before: CameraState, prior: BodyPrior | None = None) -> AngleTrack:
    """Estimate the angle of a rigid body in every frame.

    Args:
        view: The points.
        matrix: Camera matrix [px], shape (3, 3).
        before: Direction of the axis, focal length and read-out, as known beforehand.
        prior: What is known of the body.

    Returns:
        The angles. Zero is arbitrary here: the attitude in one of the frames.
    """
    prior = prior or BodyPrior()
    some = keyframes_of(view, prior.still)
    found = fit_circles(view, some, matrix, before, prior, before)
    other = None
    if {0, 1} <= set(before.free):
        # From afar, a slant to one side and to the other look alike: the search may have ended in the wrong one.
        away = found.camera_state.value * [-1, -1, 1, 1] + before.value * [2, 2, 0, 0]
        other = fit_circles(view, some, matrix, before, prior, found.camera_state.at(away))
        found, other = (other, found) if other.cost < found.cost else (found, other)
    n = len(view)
    angle, misfit, size, speed = np.full(n, np.nan), np.full(n, np.nan), np.ones(n), np.zeros(n)
    for rows in view.chunks():
        seen, mask = in_view(view, rows, matrix, found)
        good = enough_points(mask)
        angle[rows] = np.where(good, seen.angle, np.nan)
        square = (np.abs(seen.rest) ** 2).sum(axis=1) / np.maximum(mask.sum(axis=1), 1)
        misfit[rows] = np.where(good, np.sqrt(square) * seen.scale, np.nan)
        size[rows] = np.where(good, (np.abs(seen.turned) ** 2).sum(axis=1) * seen.scale**2, 1.0)
        speed[rows] = point_speed(view, rows)
    wrong = misfit > 12 * (float(np.nanmedian(misfit)) + POINT_FLOOR) + BLUR_SHARE * speed
    angle[wrong] = np.nan
    variance = found.noise.variance(speed) * prior.alike / size + left_out(speed, found, prior) ** 2
    variance += smear(angle) ** 2
    common = common_variance(view, angle, matrix, found)
    if other is not None:
        common += slant_ambiguity(view, angle, matrix, found, other)
    seen = np.isfinite(angle)
    return AngleTrack(
        unwrap(angle),
        np.where(seen, np.sqrt(variance + common), np.nan),
        found.camera_state,
        float(np.sqrt(found.noise.rest)),
        int(wrong.sum()),
        found.body.shape,
        np.where(seen, np.sqrt(variance), np.nan),
    )
