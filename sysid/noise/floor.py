"""The noise floor of releases: the standard deviation of the sensor noise."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from sysid.errors import SysidError
from sysid.noise.sensor import divided_differences, quantisation_step
from sysid.quantity import Z95
from sysid.roll import Array, Release

_ORDER = 10
"""Order of the differences: of a motion with ten samples a period they keep 2e-5."""
_FREEDOMS = 8
"""Columns of a linear law in one swing: level and drift, amplitude and phase with their drifts, and twice the frequency."""
_ENOUGH = 8
"""Fewest differences of a release from which its noise is estimated."""
FROM_SCATTER = "estimated from the sample-to-sample scatter"
"""How the noise floor was found if it is the scatter of neighbouring samples."""
FROM_STEPS = "from the sensor's steps"
"""How it was found if the sensor counts steps that are coarser than its noise."""


@dataclass(frozen=True, slots=True)
class NoiseFloor:
    """Standard deviation of the sensor noise, and how it was found."""

    std: float
    """[rad], or [rad/s] for a rate."""
    how: str
    relative_std: float = 0.0
    """Standard deviation of `std` itself, as a share of it."""

    @property
    def counts(self) -> bool:
        """Whether the sensor counts steps that are coarser than its noise."""
        return self.how.startswith(FROM_STEPS)

    @property
    def highest(self) -> float:
        """Upper end of the 95 % interval of `std`."""
        return self.std * (1 + Z95 * self.relative_std)

    @property
    def lowest(self) -> float:
        """Lower end of the 95 % interval of `std`."""
        return self.std * max(0.0, 1 - Z95 * self.relative_std)

    def excess(self, rmse: float) -> tuple[float, float, float]:
        """Return an error without the noise: lower end of its 95 % interval, value, upper end."""
        least, value, most = (
            float(np.sqrt(max(rmse**2 - std**2, 0.0))) for std in (self.highest, self.std, self.lowest)
        )
        return least, value, most


def difference_std(curves: Sequence[tuple[Array, Array]]) -> float:
    """Return the noise of sampled smooth motions from their high-order differences.

    Differences of order m suppress a motion of frequency f by (2 sin πf/f_s)^m and keep white noise. If a few kinks dominate, the median
    absolute deviation counts instead.

    Args:
        curves: Signals and when they were sampled [s], each pair of shape (n,); steps may differ. Curves of less than 18 samples
            are ignored.

    Returns:
        Standard deviation in the signals' unit; inf without a curve. It holds for noise that is independent from sample
        to sample; a smoothing sensor has more.
    """
    parts = [
        divided_differences(*(sliding_window_view(values, _ORDER + 1) for values in (time, signal)))
        for signal, time in curves
        if len(time) - _ORDER >= _ENOUGH
    ]
    if not parts:
        return math.inf
    differences = np.concatenate(parts)
    std = float(np.sqrt(np.mean(differences**2)))
    robust = float(np.median(np.abs(differences - np.median(differences)))) / 0.6745  # of a normal variable
    return robust if std > 1.3 * robust > 0 else std


def noise_floor(releases: Sequence[Release], *, rate: bool = False) -> NoiseFloor:
    """Estimate the sensor noise of some releases.

    Differences of neighbouring samples, pooled over all samples, show white noise. They do not show the noise of a
    sensor that smooths (a filter, a fusion of sensors); the spread at rest shows it. A sensor with coarse steps shows
    no noise at rest; its variance is at least a twelfth of the step squared.

    Raises:
        SysidError: No release has the 18 samples that differences take.
    """
    signals = [one.rate if rate and one.rate is not None else one.roll for one in releases]
    curves = [(signal, release.time) for signal, release in zip(signals, releases, strict=True)]
    count = sum(len(time) for _, time in curves if len(time) - _ORDER >= _ENOUGH)
    if not count:
        longest = max(len(time) for _, time in curves)
        raise SysidError(
            f"the longest release has {longest} samples, too few to tell noise from motion. Record at a higher rate, "
            "until the deck rests."
        )
    std = difference_std(curves)
    still, resting = 0.0, 0
    for release, (signal, time) in zip(releases, curves, strict=True):
        first, middle, last = (int(share * len(signal)) for share in (0.5, 0.725, 0.95))
        if release.end == "rest" and middle - first >= 2 * _ENOUGH:
            parts = (slice(first, middle), slice(middle, last))
            halves = [_without_swing(signal[part], time[part]) for part in parts]
            # Noise does not fade, a last swing does.
            quiet = min(halves, key=lambda half: float(np.mean(half**2)))
            power = np.abs(np.fft.rfft(quiet)) ** 2
            if power.max(initial=0.0) < 0.25 * power.sum():  # else it still swings
                still, resting = still + float(np.sum(quiet**2)), resting + len(quiet)
    unit = "rad/s" if rate else "rad"
    level = quantisation_step(np.concatenate([np.diff(signal) for signal, _ in curves]))
    if level / np.sqrt(12) > std:
        return NoiseFloor(level / float(np.sqrt(12)), f"{FROM_STEPS} of {level:.3g} {unit}")
    spread = float(np.sqrt(still / resting)) if resting > 50 else 0.0
    # Differences that are worth one independent sample: Σ ρ² of their autocorrelation ρ.
    per_independent = comb(4 * _ORDER, 2 * _ORDER) / comb(2 * _ORDER, _ORDER) ** 2
    if spread > 1.2 * std:
        return NoiseFloor(
            spread,
            f"from the spread at rest; the sensor smooths (sample to sample it moves by {std:.2g} {unit} only)",
            float(np.sqrt(0.5 / resting)),
        )
    return NoiseFloor(
        std,
        f"{FROM_SCATTER} of the {count} samples of the releases",
        float(np.sqrt(0.5 * per_independent / max(count - _ORDER * len(releases), _ENOUGH))),
    )


def local_noise(curves: Sequence[tuple[Array, Array]], poles: Array) -> NoiseFloor:
    """Return the noise of sampled decays: their scatter about a linear law whose amplitude, phase and level change with time.

    A window lasts at least a period and has at least three samples for each column of the law. Filtered noise counts in
    full if its correlation time is shorter than a window.

    Args:
        curves: Sampling times [s] and signal of each decay, each pair of shape (n,).
        poles: (ln m, τ) of `m ẍ + τ ẋ + x = 0`, shape (2,).
    """
    stiffness = float(np.exp(-poles[0]))
    decay = 0.5 * float(poles[1]) * stiffness
    square = stiffness - decay**2
    power, free, quiet = 0.0, 0, list[float]()
    for time, signal in curves:
        slow = np.sqrt(square) if square > 0 else stiffness / (decay + np.sqrt(-square))
        count = int(np.searchsorted(time, time[0] + 2 * np.pi / slow))
        pieces = max(1, len(time) // max(count, 3 * _FREEDOMS))
        for rows in np.array_split(np.arange(len(time)), pieces):
            if len(rows) <= _FREEDOMS:
                continue
            t = time[rows] - time[rows[0]]
            ramp = 2 * t / max(float(t[-1]), 1e-300) - 1
            if square > 0:
                fade, phase = np.exp(-decay * t), np.sqrt(square) * t
                c, s = fade * np.cos(phase), fade * np.sin(phase)
                twice = [fade**2 * np.cos(2 * phase), fade**2 * np.sin(2 * phase)]
                table = np.column_stack([np.ones_like(t), ramp, c, s, ramp * c, ramp * s, *twice])
            else:
                table = np.polynomial.legendre.legvander(ramp, _FREEDOMS - 1)
            orthogonal, _ = np.linalg.qr(table / (np.linalg.norm(table, axis=0) + 1e-300))
            left = signal[rows] - orthogonal @ (orthogonal.T @ signal[rows])
            power, free = power + float(left @ left), free + len(rows) - _FREEDOMS
            quiet.append(float(left @ left) / (len(rows) - _FREEDOMS))
    if not free:
        return NoiseFloor(float("inf"), "the releases are too short to tell noise from motion", 1.0)
    std = float(np.sqrt(power / free))
    usual = float(np.sqrt(np.median(quiet)))
    if std > 1.3 * usual > 0 and len(quiet) > 4:  # a few kinks, not the noise
        std = usual
    return NoiseFloor(std, f"scatter within a swing, of {free} samples", float(np.sqrt(0.5 / free)))


def _without_swing(tail: Array, time: Array) -> Array:
    """Return a stretch at rest without its trend and without the rest of the swing before.

    The swing is a sine of smoothly falling amplitude at the frequency of the largest power.
    """
    t = np.interp(time, (time[0], time[-1]), (-1, 1))  # time, not sample number: samples may be lost
    wander = tail - np.polyval(np.polyfit(t, tail, 1), t)
    size = 8 * len(tail)
    peak = int(np.argmax(np.abs(np.fft.rfft(wander, size))))
    phase = np.pi * peak / size * (len(tail) - 1) * t
    sine = [shape * t**power for shape in (np.cos(phase), np.sin(phase)) for power in range(3)]
    table = np.column_stack([np.ones_like(t), t, *sine])
    rest = tail - table @ np.linalg.lstsq(table, tail, rcond=None)[0]
    # White noise loses as many of its degrees of freedom as the table has columns.
    return rest * np.sqrt(len(tail) / max(len(tail) - table.shape[1], 1))
