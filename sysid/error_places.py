"""Where a model's error sits: when, at which amplitude, at which speed, on which side; in words."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from sysid.roll import Array

if TYPE_CHECKING:
    from sysid.compare import ReleaseComparison

Axis = Literal["time", "amplitude", "velocity", "side"]
CELLS = 10
UNEVEN = 0.15
"""Share of the error, beyond the share of the samples, from which a place is worth naming."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A range along one axis that holds more of the error than of the samples."""

    axis: Axis
    low: float
    high: float
    """[s], [rad], [rad/s] (negative: on the way back to rest), or the sign of the side."""
    share: float
    """Of the squared error."""
    text: str


def error_places(releases: Sequence["ReleaseComparison"], noise: float) -> tuple[Place, ...]:
    """Find the ranges of time, amplitude, velocity and side that hold most of the error.

    Args:
        releases: Measured beside simulated.
        noise: Standard deviation of the sensor [rad]; its share is taken off everywhere alike.

    Returns:
        For each axis the range whose share of the squared error exceeds its share of the samples by most,
        if it does so by more than `UNEVEN`; the most telling first.
    """
    tilt = np.concatenate([r.measured - r.rest for r in releases])
    rate = np.concatenate([r.rate for r in releases])
    time = np.concatenate([r.time for r in releases])
    error = np.concatenate([r.residual for r in releases]) ** 2
    outward = rate * np.sign(tilt)
    axes: tuple[tuple[Axis, Array, Array, Callable[[float, float, float], str]], ...] = (
        ("time", time, _even_edges(time), _say_time),
        ("amplitude", np.abs(tilt), _even_edges(np.abs(tilt)), _say_amplitude),
        ("velocity", outward, np.linspace(-np.abs(rate).max(), np.abs(rate).max(), CELLS + 1), _say_velocity),
        ("side", np.sign(tilt), np.array([-1.5, 0.0, 1.5]), _say_side),
    )
    found: list[tuple[float, Place]] = []
    for axis, value, edges, say in axes:
        total, _ = np.histogram(value, edges, weights=error)
        count, _ = np.histogram(value, edges)
        beyond = np.maximum(total - count * noise**2, 0.0)
        if beyond.sum() <= 0:
            continue
        share, samples = beyond / beyond.sum(), count / count.sum()
        begin, end = _densest(share - samples)
        part = float(share[begin:end].sum())
        surplus = part - float(samples[begin:end].sum())
        if surplus > UNEVEN:
            low, high = float(edges[begin]), float(edges[end])
            found.append(
                (surplus, Place(axis=axis, low=low, high=high, share=part, text=say(low, high, part)))
            )
    return tuple(place for _, place in sorted(found, key=lambda item: -item[0]))


def _even_edges(values: Array) -> Array:
    return np.linspace(0.0, float(values.max()) * (1 + 1e-9), CELLS + 1)


def _densest(surplus: Array) -> tuple[int, int]:
    """Return the run of cells [begin, end) with the largest sum (Kadane's algorithm)."""
    best, begin, end = -np.inf, 0, 1
    running, start = 0.0, 0
    for i, value in enumerate(surplus):
        if running <= 0:
            running, start = 0.0, i
        running += float(value)
        if running > best:
            best, begin, end = running, start, i + 1
    return begin, end


def _percent(share: float) -> str:
    return f"{round(100 * share)} % of the error"


def _say_time(low: float, high: float, share: float) -> str:
    return f"{_percent(share)} lies between {low:.2f} and {high:.2f} s after the release"


def _say_amplitude(low: float, high: float, share: float) -> str:
    low_deg, high_deg = np.degrees(low), np.degrees(high)
    if low == 0:
        return f"{_percent(share)} lies below {high_deg:.1f}° of tilt"
    return f"{_percent(share)} lies between {low_deg:.1f}° and {high_deg:.1f}° of tilt"


def _say_velocity(low: float, high: float, share: float) -> str:
    if low >= 0:
        return f"{_percent(share)} arises while it swings outward, at {low:.2g} to {high:.2g} rad/s"
    if high <= 0:
        return f"{_percent(share)} arises on the way back to rest, at {-high:.2g} to {-low:.2g} rad/s"
    return f"{_percent(share)} arises at low speed, between {low:.2g} and {high:.2g} rad/s"


def _say_side(low: float, high: float, share: float) -> str:
    del high
    return f"{_percent(share)} lies on the {'right' if low >= 0 else 'left'} side"
