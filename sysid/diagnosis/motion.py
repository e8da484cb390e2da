"""Free motion on a uniform grid, in units of the widest swing and of one radian of the joint's natural swing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from sysid.errors import SysidError
from sysid.roll import Array, Release

Mask = npt.NDArray[np.bool_]

NODES = 64
"""Grid nodes a period. Torques are linear between nodes: at the peak of a swing that is off by (2π/64)²/8 = 0.12 %."""
MOST_NODES = 6000
"""Grid nodes in all: a longer log gets a coarser grid, down to `FEWEST` nodes a period."""
FEWEST = 20
"""Nodes a period of the coarsest grid: linear interpolation is then off by 1.2 % at the peak of a swing."""
CLEAR = 7.0
"""A swing counts while its range is so many times the noise of a sample."""
QUIET = 0.02
"""A swing counts while its range is at least this share of the widest swing."""
LETTING_GO = 0.04
"""Share of a period after a release in which a hand may still touch."""
SHORTEST = 12
"""Samples of the shortest release that is used."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Releases on one grid: row r is a release, column j a node. Angles over `amplitude`, time times `frequency`."""

    amplitude: float
    """Widest swing A about rest [rad]."""
    frequency: float
    """Natural frequency ω₀ that makes time dimensionless [rad/s]."""
    step: float
    """Step h of the grid [rad of swing]."""
    reading: Array
    """Mean of the samples at each node over A (angle) or A ω₀ (rate), shape (r, n)."""
    variance: Array
    """Its variance, shape (r, n); inf where no sample is, or none counts."""
    lag: Array
    """Mean time of these samples after the node [rad of swing], shape (r, n)."""
    length: npt.NDArray[np.intp]
    """Nodes of each release, shape (r,)."""
    envelope: Array
    """Local amplitude over A, shape (r, n)."""
    hold: Array
    """Angle over A at which each release was held, shape (r,)."""
    held: Array
    """For how long [rad of swing], shape (r,)."""
    rest: float
    """Angle from which the motion counts [rad]."""
    is_rate: bool
    """Whether the reading is the rate."""
    zero: Literal["known", "constant", "drifting"]
    """Zero of the reading: the joint's own, unknown but fixed, or another in each release."""
    starts: Array
    """Time of the first node of each release on the log's clock [s], shape (r,)."""
    releases: npt.NDArray[np.intp]
    """Place of each row's release among those given, shape (r,)."""
    free: npt.NDArray[np.intp]
    """Free part of each release: first node, and the node from which a hand may act or -1, shape (r, 2)."""

    @property
    def inside(self) -> Mask:
        """Nodes that belong to a release [1], shape (r, n)."""
        return np.arange(self.reading.shape[1])[None] < self.length[:, None]

    @property
    def nodes_a_period(self) -> int:
        """Return the nodes a period."""
        return round(2 * np.pi / self.step)

    def local(self, torque: Array, stiffness: float) -> Array:
        """Return the envelope, or a torque over the stiffness where that is larger near by [1], shape (r, n) each."""
        size = self.nodes_a_period // 16 + 1
        return np.maximum(self.envelope, maximum_filter1d(np.abs(torque), size, axis=1) / stiffness)


def motion_of(
    releases: Sequence[Release], rest: float, noise: float, *, rate: bool, frequency: float | None = None
) -> Motion:
    """Put the free motion of some releases on a grid.

    Args:
        releases: Free decays.
        rest: Angle from which the motion counts where the sensor's zero is the joint's [rad].
        noise: Noise of a sample [rad or rad/s]: that of the usual one, where the log states one for each.
        rate: Whether to use the measured rate.
        frequency: Natural frequency [rad/s]; estimated if left out.

    Raises:
        SysidError: No release holds enough motion.
    """
    zero = releases[0].zero if not rate else "known"
    levels = [rest if zero == "known" else release.rest for release in releases]
    swings = [float(np.abs(r.roll - r.rest).max()) for r in releases]
    omega = frequency or natural_frequency(releases[int(np.argmax(swings))], rate=rate)
    period, amplitude = 2 * np.pi / omega, max(swings)
    unit = amplitude * omega if rate else amplitude
    small = noise / omega if rate else noise
    cuts = [_cut(release, period, amplitude, small) for release in releases]
    used = [i for i, (a, b, _) in enumerate(cuts) if b - a >= SHORTEST]
    if not used:
        raise SysidError(
            f"no release has {SHORTEST} samples of motion above the noise. Record faster, or start wider."
        )
    seconds = [float(releases[i].time[cuts[i][1] - 1] - releases[i].time[cuts[i][0]]) for i in used]
    nodes = int(np.clip(MOST_NODES * period / sum(seconds), FEWEST, NODES))
    step = period / nodes
    count = max(round(s / step) for s in seconds) + 1
    rows: list[tuple[npt.NDArray[np.intp], Array, Array, Array]] = []
    for i in used:
        part = slice(*cuts[i][:2])
        values, stds = (a[part] for a in _measured(releases[i], levels[i], rate=rate))
        rows.append(_row(releases[i].time[part], values, stds * (noise / np.median(stds)), step, count))
    places, means, variances, lags = zip(*rows, strict=True)
    angles = [
        np.interp(np.arange(count), place, (releases[i].roll[slice(*cuts[i][:2])] - levels[i]) / amplitude)
        for i, place in zip(used, places, strict=True)
    ]
    length = np.array([place[-1] + 1 for place in places], dtype=np.intp)
    held = [r.roll[:1] if r.held is None else r.held.roll for r in (releases[i] for i in used)]
    free = [(0, n if cuts[i][2] else -1) for i, n in zip(used, length, strict=True)]
    return Motion(
        amplitude=amplitude, frequency=omega, step=2 * np.pi / nodes, reading=np.array(means) / unit,
        variance=np.array(variances) / unit**2, lag=np.array(lags) * omega, length=length,
        envelope=np.maximum([_envelope(one, nodes) for one in angles], QUIET / 2),
        hold=np.array([float(np.median(h)) - levels[i] for i, h in zip(used, held, strict=True)]) / amplitude,
        held=np.array([releases[i].hold for i in used]) * omega, rest=rest, is_rate=rate, zero=zero,
        starts=np.array([releases[i].time[cuts[i][0]] for i in used]), releases=np.array(used, dtype=np.intp),
        free=np.array(free, dtype=np.intp),
    )  # fmt: skip


def _measured(release: Release, level: float, *, rate: bool) -> tuple[Array, Array]:
    """Return the rate of a release, or its angle from a level, and the noise of its samples, shape (n,) each."""
    if rate and release.rate is not None and release.rate_std is not None:
        return release.rate, release.rate_std
    return release.roll - level, release.std


def _row(
    time: Array, values: Array, stds: Array, step: float, count: int
) -> tuple[npt.NDArray[np.intp], Array, Array, Array]:
    """Put samples on a grid of some nodes, `step` [s] apart.

    Returns:
        Node of each sample, shape (s,). Mean reading of each node, its variance (inf without a sample), and the mean time of its samples
        after it [s], shape (n,) each.
    """
    after = time - time[0]
    place = np.rint(after / step).astype(np.intp)
    number = np.bincount(place, minlength=count).astype(float)
    some = number > 0
    mean, lag, variance = np.zeros(count), np.zeros(count), np.full(count, np.inf)
    mean[some] = np.bincount(place, values, count)[some] / number[some]
    lag[some] = np.bincount(place, after - place * step, count)[some] / number[some]
    variance[some] = np.bincount(place, stds**2, count)[some] / number[some] ** 2
    return place, mean, variance, lag


def judged_part(releases: Sequence[Release], motion: Motion) -> list[Release]:
    """Return the releases without the ends that the motion leaves out: those of a hand, and those of noise alone."""
    found = list(releases)
    for row, (first, end) in enumerate(motion.free):
        at = int(motion.releases[row])
        release, second = found[at], motion.step / motion.frequency
        if first:
            part = release[release.time >= motion.starts[row] + first * second]
            found[at] = release = replace(part, hold=0.0, held=None)
        if end >= 0:
            found[at] = replace(release[release.time < motion.starts[row] + end * second], end="caught")
    return found


def natural_frequency(release: Release, *, rate: bool) -> float:
    """Estimate ω₀ of a release [rad/s]: from zero crossings, or where there are few from integrals of the motion.

    Twice integrated, ẍ + d ẋ + k x = 0 is linear in k and d without any derivative of the log.
    """
    time, angle = release.time - release.time[0], release.roll - release.rest
    signal = release.rate if rate and release.rate is not None else angle
    wide = 0.05 * float(np.abs(signal).max())
    side = np.where(signal > wide, 1, np.where(signal < -wide, -1, 0))
    clear = np.flatnonzero(side)
    crossings = clear[1:][side[clear[1:]] != side[clear[:-1]]]
    if len(crossings) > 3:
        return float(np.pi / np.median(np.diff(time[crossings])))
    span = time[-1]
    once = _integral(time, signal)
    twice = _integral(time, once)
    table = np.column_stack([np.ones_like(time), time, once, twice, *([] if rate else [time**2])])
    stiffness = -float(np.linalg.lstsq(table, signal, rcond=None)[0][3])
    return float(np.sqrt(max(stiffness, (np.pi / span) ** 2)))


def _integral(time: Array, values: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])


def _cut(release: Release, period: float, amplitude: float, noise: float) -> tuple[int, int, bool]:
    """Return the first sample and the end of the motion that stands clear of the noise, and whether more follows."""
    time = release.time
    first = int(np.searchsorted(time, time[0] + LETTING_GO * period))
    ends = np.arange(time[0], time[-1], period / 2)
    last, quiet = time[-1] - (0.1 * period if release.end == "caught" else 0.0), False
    for begin in ends:
        part = (time >= begin) & (time < begin + period)
        whole = begin + 0.7 * period < time[-1]
        away = 2 * float(np.abs(release.roll[part] - release.rest).max(initial=0.0))
        if whole and part.any() and away < max(QUIET * amplitude, CLEAR * noise):
            last, quiet = min(last, begin + period / 2), True
            break
    return first, int(np.searchsorted(time, last, side="right")), quiet


def _envelope(angle: Array, nodes: int) -> Array:
    """Return half the range of the angle within a period about each node."""
    size = nodes + 1
    return (maximum_filter1d(angle, size) - minimum_filter1d(angle, size)) / 2
