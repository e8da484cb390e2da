"""Roll of the deck against time, and the free decays found in it.

Sign, everywhere: x forward, y left, z up; roll is the rotation about +x, so positive roll is right
edge down. The tilt joint of our MJCF turns about +x too, so its position is the roll; the paper's tilt
turns about -x (γ = -roll), and that sign flips in `sim/skate` only.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

Origin = Literal["angle", "gyro", "imu", "quaternion", "video"]
"""What the roll was made from: an angle column, an integrated rate gyro, accelerometer and gyro
together, an orientation quaternion, or a film."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Roll:
    """One log's roll signal."""

    log: str
    """Path of the log, as the user named it."""
    time: Array
    """Time since the first sample [s], shape (n,), strictly increasing."""
    roll: Array
    """Roll [rad], shape (n,), unwrapped."""
    std: Array
    """Standard deviation of each sample [rad], shape (n,): sensor noise, not a common offset."""
    origin: Origin
    rate: Array | None = None
    """Roll rate [rad/s], shape (n,), where a gyro measured it; `roll` is its integral if origin is 'gyro'."""
    rate_std: Array | None = None
    """Standard deviation of `rate` [rad/s], shape (n,)."""
    own_std: Array | None = None
    """Share of `std` that is not common to all samples [rad], shape (n,), where that is known: a lens or a slant
    stretches or skews a whole swing, which hardly touches its frequency and its damping."""
    notes: tuple[str, ...] = ()
    """What was inferred while reading (column, unit, sampling rate, clock repairs), for people."""
    warnings: tuple[str, ...] = ()
    """What is wrong with the log, for people."""

    @property
    def sampling_rate(self) -> float:
        """Median sampling rate [Hz]."""
        return float(1.0 / np.median(np.diff(self.time)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Release:
    """One free decay: the stretch of a log between letting go and rest, catch or end."""

    log: str
    number: int
    """Counted from 1 within its log."""
    time: Array
    """Time on the log's clock [s], shape (n,)."""
    roll: Array
    """Measured roll [rad], shape (n,), not shifted by the rest angle."""
    std: Array
    """Standard deviation of each sample [rad], shape (n,)."""
    origin: Origin
    rate: Array | None = None
    """Measured roll rate [rad/s], shape (n,), where there is one."""
    rate_std: Array | None = None
    own_std: Array | None = None
    """Share of `std` that is not common to all samples [rad], shape (n,), where that is known."""
    rest: float
    """Roll at rest about this release, as first estimated from the log [rad]."""
    hold: float
    """Time for which the deck was held still before the release [s]; 0 where it was not."""
    end: Literal["rest", "caught", "log"]
    """Why it ends: the deck came to rest, somebody caught it, or the log stops."""

    @property
    def start(self) -> float:
        """Time of the release on the log's clock [s]."""
        return float(self.time[0])

    @property
    def side(self) -> Literal["right", "left"]:
        """The edge that was down when the deck was let go."""
        return "right" if self.roll[0] > self.rest else "left"

    @property
    def amplitude(self) -> float:
        """First amplitude about rest [rad], positive."""
        return float(np.abs(self.roll[0] - self.rest))
