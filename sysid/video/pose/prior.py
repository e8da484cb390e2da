"""A rigid body as it is known before a film is looked at: a square, a plane, or points anywhere."""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.pose.body import Body
from sysid.video.pose.camera_state import READOUT, CameraState

SQUARE_SQUEEZE = 0.0075
"""Standard deviation of a printed square's squareness: one that stands 7 degrees off looks 0.75 % narrower."""
PLANE_CENTRES = 0.0005
"""Standard deviation of the circles' centres of points in one plane across the axis, in focal lengths: a
twentieth of a focal length aside, at depths that differ by 1 %."""
POINT_FLOOR = 0.02
"""Least standard deviation of a point's position [px]: pixels and lens have faults of their own."""
SAME_PICTURE = 0.25
"""Motion up to which a picture is still the same one, with the same errors [px]."""


@dataclass(frozen=True, slots=True)
class BodyPrior:
    """What is known beforehand of a body."""

    square: bool = False
    """Its points are the corners of a square that stands across the axis (to within 7 degrees), in order."""
    centre_std: float = PLANE_CENTRES
    """Standard deviation of the circles' centres, in focal lengths."""
    alike: float = 1.0
    """How many points share their errors, so that they count as one."""
    floor: float = POINT_FLOOR
    """Least standard deviation of a point's position [px]."""
    shows_lens: bool = True
    """Whether its points are known well enough to tell the focal length by; it stays in doubt otherwise."""
    dead_zone: float = 0.0
    """Motion that compression may leave out of the film, to either side [px]: the less contrast, the more."""
    still: float = SAME_PICTURE
    """Motion up to which its points keep their errors [px]."""


def add_priors(
    normal: Array,
    pull: Array,
    body: Body,
    now: CameraState,
    before: CameraState,
    prior: BodyPrior,
    focal: float,
) -> float:
    """Add what is known beforehand to the normal equations, in place; return its cost.

    Args:
        normal: Normal matrix, shape (4N + p, 4N + p): [1/px²] for the body, one over their units for the camera's p.
        pull: Minus the gradient, shape (4N + p,): [1/px] for the body.
        body: The body so far.
        now: The camera so far.
        before: The camera as known beforehand.
        prior: The body as known beforehand.
        focal: Focal length [px].
    """
    size = len(body.shape)
    length = np.sqrt(np.mean(np.abs(body.shape) ** 2))
    diagonal = np.arange(2 * size)
    tight = (prior.centre_std * focal) ** -2
    normal[diagonal, diagonal] += tight
    centre = np.concatenate([body.centre.real, body.centre.imag])
    pull[diagonal] -= centre * tight
    cost = float(centre @ centre) * tight
    normal[diagonal + 2 * size, diagonal + 2 * size] += length**-2  # a hair: shift and turn are free
    if prior.square:
        ideal = np.exp(1j * np.pi / 2 * np.arange(size))
        off = (np.eye(size) - np.outer(ideal, ideal.conj()) / size) / (SQUARE_SQUEEZE * length) ** 2
        shape = slice(2 * size, 4 * size)
        normal[shape, shape] += np.block([[off.real, -off.imag], [off.imag, off.real]])
        wrong = off @ body.shape
        pull[shape] -= np.concatenate([wrong.real, wrong.imag])
        cost += float(np.vdot(body.shape, wrong).real)
    if free := before.free:
        information = np.linalg.inv(before.covariance[np.ix_(free, free)])
        moved = now.value[free] - before.value[free]
        moved[[number == READOUT for number in free]] = (
            0.0  # a read-out is as likely anywhere within its limits
        )
        normal[4 * size :, 4 * size :] += information
        pull[4 * size :] -= information @ moved
        cost += float(moved @ information @ moved)
    return cost
