"""The angle of a body that turns about an axis, from points in pictures.

A camera that does not look along the axis sees circles as ellipses, and at more depth than one. A homography takes its picture to that of a camera along the
axis, in which points run on circles. It is known up to the axis' direction and the focal length. Direction, focal length
and read-out of the shutter make these circles round (`circles`).
"""

from dataclasses import dataclass, replace

import numpy as np

from sysid.roll import Array
from sysid.video.pose.camera_state import READOUT, CameraState, spread_by
from sysid.video.pose.circles import Found, fit_circles
from sysid.video.pose.keyframes import BLUR_SHARE, keyframes_of, point_speed
from sysid.video.pose.prior import POINT_FLOOR, SLOPE, BodyPrior
from sysid.video.pose.rectify import smear, unwrap
from sysid.video.pose.view import View
from sysid.video.types import Complex


@dataclass(frozen=True, slots=True)
class AngleTrack:
    """How a body turned, as seen by the camera."""

    angle: Array
    """Angle about the axis, clockwise in the picture [rad], shape (n,), unwrapped; NaN where not seen."""
    std: Array
    """Standard deviation of each angle [rad], shape (n,): noise, blur and the unknown camera;
    not a common offset."""
    camera_state: CameraState
    """Direction, lens and shutter as fitted."""
    noise: float
    """Standard deviation of a point's position at rest [px]."""
    outliers: int
    """Frames left out because their points do not fit a turning body."""
    shape: Complex
    """The body's points at angle zero, as a camera along the axis sees them, about their middle."""
    own: Array
    """Share of `std` that is not common to all frames [rad], shape (n,)."""

    @property
    def scale_std(self) -> float:
        """Share of the swing that is open in common for all frames [1]: of direction, lens and pivot."""
        common = np.sqrt(np.nanmax(np.maximum(self.std**2 - self.own**2, 0.0)))
        return float(common / np.nanmax(np.abs(self.angle - np.nanmedian(self.angle))))


def fit_angle(view: View, matrix: Array, before: CameraState, prior: BodyPrior | None = None) -> AngleTrack:
    """Estimate the angle [rad] of a rigid body in every frame that shows all of its points; zero is the attitude in one of them.

    The camera matrix [px] has shape (3, 3).
    """
    prior = prior or BodyPrior()
    some = keyframes_of(view, prior.still)
    slopes = (SLOPE, -SLOPE) if prior.any_side else (0.0,)
    fits = [fit_circles(view, some, matrix, before, prior, before.value, slope) for slope in slopes]
    if {0, 1} <= set(before.free):  # from the other side a body looks nearly the same
        mirrored = fits[0].camera_state.value * [-1, -1, 1, 1]
        fits.append(fit_circles(view, some, matrix, before, prior, mirrored))
    likelihood = np.array([one.likelihood for one in fits])
    odds = np.exp(likelihood - likelihood.max())
    chance = odds / odds.sum()
    found = fits[int(np.argmax(chance))]

    def angle_of(one: Found, x: Array) -> Array:
        return one.unknowns.body(x).placed(view.points, view.shear)[0]

    speed = point_speed(view)
    angle, rest = found.body.placed(view.points, view.shear)
    misfit = np.sqrt((rest**2).sum(axis=2).mean(axis=1))
    wrong = misfit > 12 * (float(np.nanmedian(misfit)) + POINT_FLOOR) + BLUR_SHARE * speed
    angle[wrong] = np.nan
    arm = np.abs(found.body.shape - found.body.shape.mean())
    variance = found.noise.variance(speed) / np.sum(arm**2) + smear(angle) ** 2
    # Compression draws anew what moves by more than a pixel a frame.
    variance += (prior.dead_zone / np.sqrt(3) / arm.max()) ** 2 * (1 + speed**2) ** -2.0
    clock = (view.time(found.camera_state.readout), view.share, before.place_of(READOUT))
    common = spread_by(found.x, found.covariance, angle, lambda x: angle_of(found, x), *clock)
    apart = np.exp(1j * (np.array([angle_of(one, one.x) for one in fits]) - angle))
    apart = np.nan_to_num(
        np.angle(apart * np.exp(-1j * np.nanmedian(np.angle(apart), axis=1, keepdims=True)))
    )
    mean = chance @ apart
    common += chance @ (apart - mean) ** 2
    own = np.where(np.isfinite(angle), np.sqrt(variance), np.nan)
    aside = np.array([one.camera_state.value for one in fits]) - found.camera_state.value
    doubt = (
        np.tensordot(chance, [one.camera_state.covariance for one in fits], 1) + (chance * aside.T) @ aside
    )
    return AngleTrack(
        unwrap(angle + mean),
        np.hypot(own, np.sqrt(common)),
        replace(found.camera_state, covariance=doubt),
        float(np.sqrt(found.noise.rest)),
        int(wrong.sum()),
        found.body.shape,
        own,
    )
