"""Knowledge of camera and lens, before and after a fit."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video.film.camera import FOCAL_SPREAD, Lens
from sysid.video.film.track import Track

*_, READOUT = range(4)
"""Index of the read-out among the four unknowns of a `CameraState`."""
DIFFERENCE_STEP = np.sqrt(np.finfo(float).eps)
"""Step of forward differences with the least error, in the unit of each unknown: rad, rad, 1, s; and focal lengths for the body's points."""


@dataclass(frozen=True, slots=True)
class CameraState:
    """Yaw and pitch of the axis [rad], logarithm of the focal length against the lens's, read-out [s]."""

    value: Array
    """Best values, shape (4,)."""
    covariance: Array
    """Shape (4, 4); zero where a value is given."""
    readout_limit: float = np.inf
    """The longest read-out there can be [s]; the shortest is 0."""

    @property
    def std(self) -> Array:
        """Standard deviations [rad, rad, 1, s], shape (4,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def free(self) -> list[int]:
        """Numbers of those that are not given."""
        return [int(number) for number in np.flatnonzero(np.diag(self.covariance) > 0)]

    def place_of(self, number: int) -> int | None:
        """Return where one of the four stands among those that are not given."""
        return self.free.index(number) if number in self.free else None

    @property
    def readout(self) -> float:
        """Time from the sensor's first to its last row [s]."""
        return float(self.value[READOUT])


def spread_by(
    x: Array,
    covariance: Array,
    angle: Array,
    angle_of: Callable[[Array], Array],
    time: Array,
    share: Array,
    readout: int | None,
) -> Array:
    """Return the variance of an angle for unknown numbers, without their effect at rest.

    A slant squeezes the picture by its square, of which the derivative where a camera looks along the axis shows nothing. So the mean square is taken over numbers one standard deviation off, to either side along each axis of their covariance.

    Args:
        x: The numbers, shape (P,), with their `covariance`, shape (P, P); `readout` tells which one is a read-out that is not given [s].
        angle: Angle at these [rad], shape (n,); `angle_of` gives it at others.
        time: Times of the frames [s], shape (n,), each read at a `share` of the read-out.

    Returns:
        Variance of the angle [rad²], shape (n,).
    """
    variance, axes = np.linalg.eigh(covariance)
    later = rate_of(time, angle) * (share - np.mean(share))
    total = np.zeros(len(angle))
    for step in (axes * np.sqrt(np.maximum(variance, 0.0))).T[variance > 0]:
        for off in (step, -step):
            change = np.angle(np.exp(1j * (angle_of(x + off) - angle)))
            if readout is not None:  # a frame that is read later shows a later angle: that is no error
                change = change - off[readout] * later
            change = np.abs(change - np.nanmedian(change))
            total += np.where(np.isfinite(change), change, np.nanmax(change)) ** 2 / 2
    return total


def rate_of(time: Array, angle: Array) -> Array:
    """Return the rate of an angle [rad/s], shape (n,); zero where it is not seen."""
    good = np.isfinite(angle)
    rate = np.zeros(len(angle))
    if good.sum() > 1:
        rate[good] = np.gradient(np.unwrap(angle[good]), time[good])
    return rate


def before_looking(
    track: Track, lens: Lens, direction_std: float, readout: float | None, angle: tuple[float, float] | None
) -> CameraState:
    """Return the prior knowledge of camera, lens and shutter; the stamps of the track limit the read-out [s].

    Yaw and pitch [rad] are known to `direction_std` unless they are given by `angle`.

    Raises:
        SysidError: The read-out is out of range.
    """
    intervals = np.diff(track.time)
    ceiling = float(np.median(intervals))
    if readout is not None and not 0 <= readout <= (most := float(np.max(intervals))):
        raise SysidError(
            f"--readout {readout:g}: a sensor reads a frame before the next one, here in 0 to {most:.3g} s; typical is 0.01 to 0.02."
        )
    focal_std = 0.0 if lens.known else FOCAL_SPREAD
    direction = direction_std if angle is None else 0.0
    std = np.array([direction, direction, focal_std, ceiling / np.sqrt(12) if readout is None else 0.0])
    first, limit = (ceiling / 2, ceiling) if readout is None else (readout, np.inf)
    return CameraState(np.array([*(angle or (0.0, 0.0)), 0.0, first]), np.diag(std**2), limit)
