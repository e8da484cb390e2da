"""What a film leaves open of an angle beside the noise of its points: camera, slant, and pictures drawn again."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from sysid.roll import Array
from sysid.video.pose.body import angle_slopes
from sysid.video.pose.camera_state import READOUT, SHUTTER_DOUBT, rate_of
from sysid.video.pose.placed_body import Found, in_view
from sysid.video.pose.prior import BodyPrior
from sysid.video.pose.view import View
from sysid.video.types import Rows

DRAWN = 2.0
"""Motion of which compression leaves out half as much as of the smallest [px/frame], as found in films of a phone's kind."""
LASTING_FRAMES = 4
"""Frames for which a motion drawn is good [1]: those about the turn of a swing."""


def slant_ambiguity(view: View, angle: Array, matrix: Array, found: Found, other: Found) -> Array:
    """Variance that is left as another slant fits almost as well; less what it does at rest [rad²], shape (n,)."""
    share = 1 / (1 + np.exp(min((other.cost - found.cost) / 2, 50.0)))
    change = np.full(len(view), np.nan)
    for rows in view.chunks():
        seen, _ = in_view(view, rows, matrix, other)
        change[rows] = np.angle(np.exp(1j * (seen.angle - angle[rows])))
    change = np.angle(np.exp(1j * (change - np.nanmedian(change))))
    return share * np.nan_to_num(change) ** 2


def left_out(speed: Array, found: Found, prior: BodyPrior) -> Array:
    """What compression leaves out of an angle [rad], shape (n,), by the points' speed [px/frame], shape (n,).

    It leaves a part of the picture as it is while that changes by little: small swings come out smaller in the film, and
    a deck that hardly moves stands still.
    """
    around = np.pad(speed, LASTING_FRAMES, mode="reflect")
    lately = sliding_window_view(around, 2 * LASTING_FRAMES + 1).max(axis=1)
    reach = float(np.abs(found.body.shape - found.body.shape.mean()).max())
    return prior.dead_zone / np.sqrt(3) / reach / (1 + (lately / DRAWN) ** 2)


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
        if (
            READOUT in found.camera_state.free
        ):  # a frame that is read later shows a later angle: that is no error
            slopes[:, -1] -= rate[rows]
        return slopes

    at_rest = np.nanargmin(np.abs(angle - np.nanmedian(angle)))
    rest = slopes_of(np.array([at_rest], np.intp))
    variance, shutter = np.zeros(len(angle)), np.zeros(len(angle))
    for rows in view.chunks():
        slopes = slopes_of(rows) - rest
        variance[rows] = np.einsum("ni,ij,nj->n", slopes, found.covariance, slopes, optimize=True)
        shutter[rows] = slopes[:, -1]
    if READOUT not in found.camera_state.free:
        return variance
    # The shutter's correction takes velocities from neighbouring frames: it is as good as they are alike.
    jump = np.abs(np.diff(shutter, prepend=shutter[:1], append=shutter[-1:]))
    return variance + (SHUTTER_DOUBT * np.fmax(jump[1:], jump[:-1]) * readout) ** 2
