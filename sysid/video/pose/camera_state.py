"""What is not known of camera and lens, before and after the film was looked at."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video.film.camera import FOCAL_SPREAD, Lens
from sysid.video.film.track import Track

READOUT = 3
"""Where the read-out stands among the four unknowns of a `CameraState`."""
READOUT_CEILING = 1 / 30
"""No sensor takes longer for a frame [s]."""
SHUTTER_DOUBT = 0.3
"""How far the shutter's correction may be off, as a share of its change from frame to frame."""
DIFFERENCE_STEPS = np.array([1e-4, 1e-4, 1e-4, 1e-4])
"""Steps of differences: rad, rad, 1, s."""


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

    @property
    def readout(self) -> float:
        """Time from the sensor's first to its last row [s]."""
        return float(self.value[READOUT])

    def stepped(self, number: int) -> tuple[Array, float]:
        """Return values with one of them moved on by a step that stays within its limits, and the step.

        Values are [rad, rad, 1, s], shape (4,), and the step is in the unit of the one that moves.
        """
        step = float(DIFFERENCE_STEPS[number])
        if number == READOUT and self.value[READOUT] + step > self.readout_limit:
            step = -min(step, float(self.value[READOUT]))
        moved = self.value.copy()
        moved[number] += step
        return moved, step

    def at(self, value: Array) -> "CameraState":
        """Return these with other values [rad, rad, 1, s], shape (4,), within the limits."""
        value = value.copy()
        value[READOUT] = np.clip(value[READOUT], 0.0, self.readout_limit)
        return replace(self, value=value)


def spread_by(
    camera_state: CameraState, angle: Array, angle_at: Callable[[Array], Array], share: Array, time: Array
) -> Array:
    """What is unknown of the camera leaves open of an angle, less what it does at rest.

    Args:
        camera_state: Values and covariance.
        angle: Angle at these values [rad], shape (n,).
        angle_at: Angle for other values.
        share: Share of the read-out at which each frame is read, shape (n,).
        time: Times of the frames [s].

    Returns:
        Variance of the angle, shape (n,).
    """
    columns: list[Array] = []
    rough = np.zeros(len(angle))
    for number in camera_state.free:
        moved, step = camera_state.stepped(number)
        change = np.angle(np.exp(1j * (angle_at(moved) - angle))) / step if step else np.zeros(len(angle))
        if number == READOUT:  # a frame that is read later shows a later angle: that is no error
            change = change - rate_of(time, angle) * (share - np.mean(share))
        change = change - np.nanmedian(change)
        change = np.where(np.isfinite(change), change, np.nanmax(np.abs(change)))
        columns.append(change)
        if number == READOUT:
            # The correction takes velocities from neighbouring frames: it is as good as they are alike.
            jump = np.abs(np.diff(change, prepend=change[:1], append=change[-1:]))
            rough = SHUTTER_DOUBT * np.fmax(jump[1:], jump[:-1]) * camera_state.readout
    if not columns:
        return rough**2
    jacobian = np.stack(columns, axis=1)
    covariance = camera_state.covariance[np.ix_(camera_state.free, camera_state.free)]
    return np.einsum("ni,ij,nj->n", jacobian, covariance, jacobian) + rough**2


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
    """Return what is known of camera, lens and shutter before the board's points are looked at.

    Args:
        track: Its shake shows the focal length, its stamps limit the read-out.
        lens: The lens.
        direction_std: Standard deviation of yaw and pitch where they are not given [rad].
        readout: Read-out [s], if it is given.
        angle: Yaw and pitch [rad], if they are given.

    Raises:
        SysidError: The read-out is none.
    """
    if readout is not None and not 0 <= readout <= 0.2:
        raise SysidError(f"--readout {readout}: a read-out takes 0 to 0.2 s; typical is 0.01 to 0.02.")
    focal, focal_std = 0.0, 0.0 if lens.known else FOCAL_SPREAD
    if track.shake.significant and track.shake.focal_std < focal_std:  # a camera that turns shows its lens
        focal, focal_std = float(np.log(track.shake.focal / lens.matrix[0, 0])), track.shake.focal_std
    ceiling = min(float(np.median(np.diff(track.time))), READOUT_CEILING)
    direction = direction_std if angle is None else 0.0
    std = np.array([direction, direction, focal_std, ceiling / np.sqrt(12) if readout is None else 0.0])
    first, limit = (ceiling / 2, ceiling) if readout is None else (readout, np.inf)
    return CameraState(np.array([*(angle or (0.0, 0.0)), focal, first]), np.diag(std**2), limit)
