"""What a film leaves open of an angle beside the noise of its points: camera, slant, and pictures drawn again."""

import numpy as np

from sysid.roll import Array
from sysid.video.pose.body import angle_slopes
from sysid.video.pose.camera_state import SHUTTER_DOUBT, rate_of
from sysid.video.pose.placed_body import Found, in_view
from sysid.video.pose.prior import BodyPrior
from sysid.video.pose.view import View
from sysid.video.types import Rows

SAME_NOISE = 0.3
"""Share of the noise from frame to frame below which a picture is an old one."""


def slant_ambiguity(view: View, angle: Array, matrix: Array, found: Found, other: Found) -> Array:
    """Variance that is left as another slant fits almost as well; less what it does at rest [rad²], shape (n,)."""
    share = 1 / (1 + np.exp(min((other.cost - found.cost) / 2, 50.0)))
    change = np.full(len(view), np.nan)
    for rows in view.chunks():
        seen, _ = in_view(view, rows, matrix, other)
        change[rows] = np.angle(np.exp(1j * (seen.angle - angle[rows])))
    change = np.angle(np.exp(1j * (change - np.nanmedian(change))))
    return share * np.nan_to_num(change) ** 2


def repeated_picture(view: View, found: Found, prior: BodyPrior) -> Array:
    """What a film leaves open that shows a picture again instead of a new one [rad], shape (n,).

    Compression leaves a part of the picture as it is while it changes by little: a deck that hardly moves
    stands still in the film. Its points then do not even scatter from frame to frame as their noise would.
    """
    moved = np.full(len(view), np.inf)
    for rows in view.chunks():
        before = np.maximum(rows - 1, 0)
        with np.errstate(invalid="ignore"):
            step = np.sum(
                (view.track.points[rows].astype(np.float64) - view.track.points[before]) ** 2, axis=2
            )
        count = np.isfinite(step).sum(axis=1)
        mean = np.nansum(step, axis=1) / np.maximum(count, 1)
        moved[rows] = np.where((count > 0) & (rows > 0), mean, np.inf)
    # Of two pictures with noise of their own, a point's places differ by four times its variance in a direction.
    repeats = moved < SAME_NOISE * 4 * found.noise.rest
    reach = float(np.abs(found.body.shape - found.body.shape.mean()).max())
    return np.where(repeats, prior.dead_zone / np.sqrt(3) / reach, 0.0)


def common_variance(view: View, angle: Array, matrix: Array, found: Found) -> Array:
    """Variance that common errors, of the body's circles and of the camera, leave; less what at rest [rad²], shape (n,).

    Args:
        view: The points.
        angle: Angle of each frame [rad], shape (n,).
        matrix: Camera matrix [px], shape (3, 3).
        found: Body and camera with their covariance.
    """
    readout = found.camera_state.readout
    rate = rate_of(view.time(readout), angle) * (view.share - np.mean(view.share))

    def slopes_of(rows: Rows) -> Array:
        seen, mask = in_view(view, rows, matrix, found)
        slopes = angle_slopes(seen.angle, seen.turned, mask, seen.slopes)
        if 3 in found.camera_state.free:  # a frame that is read later shows a later angle: that is no error
            slopes[:, -1] -= rate[rows]
        return slopes

    at_rest = np.nanargmin(np.abs(angle - np.nanmedian(angle)))
    rest = slopes_of(np.array([at_rest], np.intp))
    variance, shutter = np.zeros(len(angle)), np.zeros(len(angle))
    for rows in view.chunks():
        slopes = slopes_of(rows) - rest
        variance[rows] = np.einsum("ni,ij,nj->n", slopes, found.covariance, slopes, optimize=True)
        shutter[rows] = slopes[:, -1]
    if 3 not in found.camera_state.free:
        return variance
    # The shutter's correction takes velocities from neighbouring frames: it is as good as they are alike.
    jump = np.abs(np.diff(shutter, prepend=shutter[:1], append=shutter[-1:]))
    return variance + (SHUTTER_DOUBT * np.fmax(jump[1:], jump[:-1]) * readout) ** 2
