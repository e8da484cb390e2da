"""Deviations of the peaks from a linear decay, and which effects of the catalogue cause them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np

from sysid.decay.peaks import Peak
from sysid.quantity import Quantity
from sysid.roll import Array, Release

if TYPE_CHECKING:
    from sysid.effects._base import DecaySign

STOPPED_SWING_SHARE = 0.015
"""A swing below this share of the first one may have been stopped half-way by friction."""
MIN_STDS = 4.0
"""A pattern is named from this many standard deviations on."""
CANDIDATES = 4
"""Effects named for what is seen; `diagnose` tries all."""
LEVELS_APART = 0.01
"""Share of the first amplitude by which rest levels must differ: sensors wander by less between releases."""
MIN_SWING_RATIO = 0.25
"""Standard deviation over half a period from which a deck still swings, over how far its level is from the middle then: half a
cosine about the middle has 0.43 at least, wherever it is cut, and a deck that stands still none."""


@dataclass(frozen=True, slots=True)
class Nonlinearity:
    """One systematic deviation from a linear decay."""

    sign: "DecaySign"
    """What the peaks show, in the words in which effects say what shows of them."""
    text: str
    """What is seen, one clause; never why: every shape has several causes."""
    hidden_by_linear_fit: bool = False
    """Whether a linear decay can hide it within the noise, with wrong stiffness and damping."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects of the catalogue that look like it, the likeliest first."""
        from sysid.effects import showing  # most decays show nothing and need no catalogue

        return showing(self.sign)

    @property
    def told(self) -> str:
        """The deviation, and a few effects that look like it."""
        from sysid.effects import effect

        few = [effect(name).title for name in self.effects[:CANDIDATES]]
        return f"{self.text}, which may be {', '.join(few[:-1])} or {few[-1]}"


def find_nonlinearities(
    releases: Sequence[Release],
    peaks: Sequence[Sequence[Peak]],
    noise: float,
    rests: Sequence[Quantity] = (),
) -> list[Nonlinearity]:
    """Return the deviations that the peaks and rest levels show beyond their noise.

    Args:
        releases: The free decays.
        peaks: Peaks of each release.
        noise: Standard deviation of a sample [rad].
        rests: Rest level of each release [rad], each fitted on its own; none where they are not measured.
    """
    found = (_levels(releases, rests), _loss(peaks), _period(peaks), _stop(releases, peaks, noise))
    return [pattern for pattern in found if pattern is not None]


def _levels(releases: Sequence[Release], rests: Sequence[Quantity]) -> Nonlinearity | None:
    """Whether the releases come to rest at different angles.

    A spring brings the deck back to one angle. Where dry friction F holds it anywhere within F/k of it, a
    linear decay with a level of its own for each release takes that for a stiffer spring: hardly more
    residual, a stiffness that is off by tens of percent.
    """
    apart = 0.0
    for (one, first), (other, second) in combinations(zip(releases, rests, strict=False), 2):
        room = max(
            MIN_STDS * math.hypot(first.std, second.std), LEVELS_APART * min(one.amplitude, other.amplitude)
        )
        apart = max(apart, abs(first.value - second.value) / room)
    if apart <= 1.0:
        return None
    value, std = (np.array([getattr(rest, name) for rest in rests]) for name in ("value", "std"))
    spread = math.degrees(float(np.ptp(value)))
    levels = ", ".join(f"{math.degrees(level):+.2f}°" for level in value[:6]) + (
        ", …" if len(value) > 6 else ""
    )
    seen = (
        f"the releases come to rest {spread:.2g}° apart ({levels}), where noise allows "
        f"{math.degrees(MIN_STDS * math.hypot(*np.sort(std)[-2:])):.1g}°"
    )
    if _drifts(releases, value, std):
        return Nonlinearity("moving level", f"{seen}, and further the later")
    return Nonlinearity("scattered levels", seen, hidden_by_linear_fit=True)


def _drifts(releases: Sequence[Release], value: Array, std: Array) -> bool:
    """Whether levels lie on a line over time, three at least, but for their noise."""
    if len(value) < 3:
        return False
    time = np.array([release.start for release in releases])
    design = np.column_stack([np.ones_like(time), time]) / std[:, None]
    line = np.asarray(np.linalg.lstsq(design, value / std, rcond=None)[0], dtype=np.float64)
    left = value / std - design @ line
    return bool(np.abs(left).max() < MIN_STDS and np.abs(left * std).max() < 0.2 * np.ptp(value))


def _loss(peaks: Sequence[Sequence[Peak]]) -> Nonlinearity | None:
    """How the amplitude lost per cycle depends on the amplitude.

    A linear decay loses in proportion. What takes the same from every swing gives a line through (amplitude, loss)
    a positive intercept; what takes more than in proportion bends it the other way.
    """
    moving = [[p for p in group if p.amplitude > STOPPED_SWING_SHARE * group[0].amplitude] for group in peaks]
    points = [point for group in moving for point in _full_cycle_losses(group)]
    if len(points) < 3:
        points = [point for group in moving for point in _half_cycle_losses(group)]
    if len(points) < 3:
        return None
    size, loss, std = np.array(points).T
    intercept, intercept_std, slope = _line(size, loss, std)
    typical = float(np.median(size))
    share = abs(intercept) / max(abs(intercept + slope * typical), 1e-12)
    if abs(intercept) < MIN_STDS * intercept_std or share < 0.1:
        return None
    if intercept > 0:
        return Nonlinearity(
            "constant loss",
            "each swing loses nearly the same angle however small it is, so the log-amplitude line bends down",
        )
    return Nonlinearity(
        "growing loss", "large swings lose more than their share, so the log-amplitude line bends up"
    )


def _period(peaks: Sequence[Sequence[Peak]]) -> Nonlinearity | None:
    """How the time between peaks depends on the amplitude."""
    points = [
        (
            ((one.amplitude + other.amplitude) / 2) ** 2,
            (other.time - one.time) / (other.number - one.number),
            math.hypot(one.time_std, other.time_std) / (other.number - one.number),
        )
        for group in peaks
        for one, other in pairwise(group)
        if one.number > 0  # the release itself is not timed well enough
    ]
    if len(points) < 3:
        return None
    square, half, std = np.array(points).T
    intercept, _, slope = _line(square, half, std)
    slope_std = math.sqrt(float(_weighted(square, half, std)[1][1, 1]))
    change = slope * float(np.ptp(square)) / intercept
    if abs(slope) < MIN_STDS * slope_std or abs(change) < 0.004:
        return None
    return Nonlinearity(
        "longer period" if slope > 0 else "shorter period",
        f"the period is {100 * abs(change):.1f} % {'longer' if slope > 0 else 'shorter'} at the largest swing than at the "
        "smallest",
    )


def _stop(releases: Sequence[Release], peaks: Sequence[Sequence[Peak]], noise: float) -> Nonlinearity | None:
    """Whether a decay stops beside the angle that it swung about."""
    for release, group in zip(releases, peaks, strict=True):
        chosen = [peak for peak in group if peak.number > 0 or len(group) < 4][:3]
        if release.end != "rest" or len(chosen) < 3 or release.measured == "rate":
            continue
        a, b, c = (peak.roll for peak in chosen)
        bend = a + c - 2 * b
        middle = (a * c - b * b) / bend
        gains = np.array([c - middle, 2 * (middle - b), a - middle]) / bend
        middle_std = float(np.linalg.norm(gains * np.array([peak.std for peak in chosen])))
        off = release.rest - middle
        half = (chosen[-1].time - chosen[0].time) / (chosen[-1].number - chosen[0].number)
        last = release.roll[release.time >= release.time[-1] - half]
        if np.std(last) > math.hypot(noise, MIN_SWING_RATIO * off):
            continue  # what still swings has not stopped
        if abs(off) > max(MIN_STDS * math.hypot(middle_std, noise / 3), 0.015 * release.amplitude):
            return Nonlinearity(
                "stops aside", f"it stops {math.degrees(abs(off)):.2g}° beside the middle of its swing"
            )
    return None


def _full_cycle_losses(group: Sequence[Peak]) -> list[tuple[float, float, float]]:
    """Mean amplitude, loss over a full cycle and its std; an error of the rest angle cancels in both."""
    return [
        (
            (a.amplitude + 2 * b.amplitude + c.amplitude) / 4,
            a.amplitude - c.amplitude,
            math.hypot(a.std, c.std),
        )
        for a, b, c in zip(group[:-2], group[1:-1], group[2:], strict=True)
        if c.number - a.number == 2
    ]


def _half_cycle_losses(group: Sequence[Peak]) -> list[tuple[float, float, float]]:
    return [
        ((a.amplitude + b.amplitude) / 2, a.amplitude - b.amplitude, math.hypot(a.std, b.std))
        for a, b in pairwise(group)
        if b.number - a.number == 1
    ]


def _line(x: Array, y: Array, std: Array) -> tuple[float, float, float]:
    """Fit y = c + m x; return c, its std (widened by scatter beyond the noise) and m."""
    solution, covariance = _weighted(x, y, std)
    return float(solution[0]), math.sqrt(float(covariance[0, 0])), float(solution[1])


def _weighted(x: Array, y: Array, std: Array) -> tuple[Array, Array]:
    design = np.column_stack([np.ones_like(x), x]) / std[:, None]
    solution = np.asarray(np.linalg.lstsq(design, y / std, rcond=None)[0], dtype=np.float64)
    scatter = float(np.sum((y / std - design @ solution) ** 2)) / max(1, len(x) - 2)
    covariance = np.asarray(np.linalg.pinv(design.T @ design), dtype=np.float64) * max(1.0, scatter)
    return solution, covariance
