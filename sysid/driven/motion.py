"""Measured angles through a low-pass filter, and their derivatives."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.roll import Array

SIGNAL_OVER_NOISE = 10.0
"""Power of the angle over its noise from which a frequency counts [1]: its torque is then known to a third."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Angles on an even grid through a low-pass filter, and their derivatives."""

    clock: Array
    """Times of the samples [s], shape (n,), increasing."""
    samples: Array
    """Measured angles [rad], shape (n,)."""
    std: float = 0.0
    """Their noise [rad]; it is at least the one that the highest frequencies have."""

    @property
    def step(self) -> float:
        """Median sampling interval [s]."""
        return float(np.median(np.diff(self.clock)))

    def grid(self, substeps: int) -> Array:
        """Return even times with so many steps a sample [s], shape (m + 1,)."""
        step = self.step / substeps
        return self.clock[0] + step * np.arange(int((self.clock[-1] - self.clock[0]) / step + 1e-6) + 1)

    @cached_property
    def time(self) -> Array:
        """Even times [s], shape (n,)."""
        return self.grid(1)

    @cached_property
    def _raw(self) -> Array:
        return np.interp(self.time, self.clock, self.samples)

    @cached_property
    def cutoff(self) -> float:
        """Highest frequency at which the angle stands above its noise [Hz]."""
        n = len(self._raw)
        window = np.hanning(n)
        line = np.polyval(np.polyfit(self.time, self._raw, 1), self.time)
        power = np.abs(np.fft.rfft((self._raw - line) * window)) ** 2 / (window**2).sum()
        wide = max(3, n // 400)
        smooth = np.convolve(power, np.ones(wide) / wide, mode="same")
        floor = max(self.std**2, float(np.median(power[n // 4 :])))
        above = np.flatnonzero(smooth > SIGNAL_OVER_NOISE * floor)
        found = np.fft.rfftfreq(n, self.step)[above[-1]] if len(above) else 0.0
        return float(np.clip(found, 10 / (self.clock[-1] - self.clock[0]), 0.2 / self.step))

    @cached_property
    def angle(self) -> Array:
        """Filtered angle [rad], shape (n,)."""
        return self.filtered(self._raw)

    @cached_property
    def rate(self) -> Array:
        """Its rate [rad/s], shape (n,)."""
        return np.gradient(self.angle, self.step)

    @cached_property
    def acceleration(self) -> Array:
        """Its acceleration [rad/s^2], shape (n,)."""
        return np.gradient(self.rate, self.step)

    def filtered(self, values: Array) -> Array:
        """Return values at the even times through the filter, without a lag, shape (n, ...), in their unit."""
        from scipy.ndimage import gaussian_filter1d

        return gaussian_filter1d(values, 1 / (2 * np.pi * self.cutoff * self.step), axis=0, mode="nearest")

    @cached_property
    def inside(self) -> slice:
        """Samples that the ends do not reach through the filter."""
        edge = max(3, int(1 / (self.cutoff * self.step)))
        return slice(edge, len(self.time) - edge)
