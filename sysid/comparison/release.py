"""One release, measured and simulated."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from sysid.diagnosis.motion import natural_frequency
from sysid.fitting.records import Record
from sysid.roll import Array, Release


@dataclass(frozen=True, kw_only=True)
class ComparedRelease:
    """One release, measured and simulated."""

    record: Record
    simulated: Array
    """[rad], or [rad/s] if the rate was compared."""
    roll: Array
    """Simulated roll [rad]."""
    rate: Array
    """Simulated rate [rad/s]."""

    @property
    def log(self) -> str:
        """Name of the log."""
        return self.record.release.log

    @property
    def number(self) -> int:
        """Counted from 1 within the log."""
        return self.record.release.number

    @property
    def name(self) -> str:
        """File and number."""
        return f"{Path(self.log).name} {self.number}"

    @property
    def time(self) -> Array:
        """Since the release [s], shape (n,)."""
        return self.record.time

    @property
    def measured(self) -> Array:
        """[rad], or [rad/s] if the rate was compared, shape (n,)."""
        return self.record.signal

    @property
    def residual(self) -> Array:
        """Simulated minus measured, shape (n,): [rad], or [rad/s] if the rate was compared."""
        return self.simulated - self.measured

    @property
    def rmse(self) -> float:
        """Root mean square residual."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def release(self) -> Release:
        """The compared samples of the release."""
        whole = self.record.release
        return whole[np.isin(whole.time - whole.time[0], self.time)]

    def as_simulated(self) -> Release:
        """Return the same samples with the simulated readings."""
        if self.record.is_rate:
            return replace(self.release, roll=self.roll, rate=self.simulated)
        return replace(self.release, roll=self.simulated, rate=None)

    @cached_property
    def window(self) -> int | None:
        """Samples in a sixth of the measured period, an odd number; None if that needs more than a third of one.

        A parabola over a sixth of a period reduces a swing by 0.03 % and its rate by 3 %. Over a third it takes 0.4 and 11 %.
        """
        period = 2 * np.pi / natural_frequency(self.record.release, rate=self.record.is_rate)
        samples = period / float(np.median(np.diff(self.time)))
        window = max(int(samples / 6) | 1, 3)  # a parabola has three coefficients
        return window if window <= min(samples / 3, len(self.time) / 2) else None


def smoothed(time: Array, signal: Array, window: int) -> tuple[Array, Array]:
    """Return a signal [rad] and its rate [rad/s] by a local parabola over an odd number of samples, shape (n,) each.

    Savitzky and Golay, Analytical Chemistry 36 (1964). Each end is continued by its reflection in the last sample.
    """
    half = window // 2
    fit = np.linalg.pinv(np.vander(np.arange(-half, half + 1) / half, 3))
    longer = np.pad(signal, half, mode="reflect", reflect_type="odd")
    _, slope, level = np.array([np.convolve(longer, row[::-1], "valid") for row in fit], dtype=np.float64)
    return level, slope / (half * float(np.median(np.diff(time))))
