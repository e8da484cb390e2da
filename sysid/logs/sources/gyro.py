"""Roll from one rotation rate: the gyro's offset, and the integral."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.logs.table.choose import Choice
from sysid.logs.table.clock import Clock
from sysid.noise.sensor import estimate_noise, saturated
from sysid.roll import Array, Roll

REST_BLOCK = 0.2
"""Length of a stretch that is tested for rest [s]."""


@dataclass(frozen=True, slots=True)
class Bias:
    """Offset of a rate gyro."""

    value: Array
    """Offset at each sample [rad/s], shape (n,)."""
    std: float
    """Standard deviation of its mean [rad/s]; inf where nothing tells it."""
    how: str


def roll_from_rate(path: Path, choice: Choice, clock: Clock, rate: Array) -> Roll:
    """Integrate one rotation rate [rad/s], shape (n,), to roll.

    The zero of roll is the rest angle, as far as the record shows it: a gyro knows no vertical. The error of
    the integral is a random walk; fits should use `Roll.rate`, whose errors are independent.
    """
    noise = estimate_noise(rate)
    bias = estimate_bias(clock.time, rate, noise.std)
    free = rate - bias.value
    steps = np.diff(clock.time)
    angle = np.concatenate(([0.0], np.cumsum(0.5 * (free[1:] + free[:-1]) * steps)))
    angle -= resting_level(angle)
    walk = noise.std * np.sqrt(np.cumsum(np.concatenate((steps[:1], steps))) * np.median(steps))
    rate_std = np.full(rate.size, noise.std)
    excess = saturated(rate, noise)
    warnings = [*clock.warnings, *choice.warnings]
    if excess is not None:
        np.maximum(rate_std, excess, out=rate_std)
        warnings.append(
            f"the gyro is saturated at {np.abs(rate[excess > 0]).max():.3g} rad/s in {np.count_nonzero(excess)} "
            "samples: angles after them are off, use a range that is wide enough"
        )
        walk = np.sqrt(walk**2 + np.cumsum((excess * np.median(steps)) ** 2))
    if not np.isfinite(bias.std):
        warnings.append(
            "no rest and no oscillation to find the gyro's offset from: taken as 0, roll may drift"
        )
    return Roll(
        log=str(path),
        time=clock.time,
        roll=angle,
        std=np.maximum(walk, noise.std * float(np.median(steps))),
        origin="gyro",
        rate=free,
        rate_std=rate_std,
        notes=(
            f"gyro offset {np.mean(bias.value):.3g} rad/s ± {bias.std:.1g} {bias.how}",
            f"gyro noise {noise.std:.2g} rad/s; roll is zero at rest, a gyro knows no vertical",
        ),
        warnings=tuple(warnings),
    )


def estimate_bias(time: Array, rate: Array, noise: float) -> Bias:
    """Find a gyro's offset from the rest at the beginning and the end, or else from the oscillation.

    Where both ends rest and differ by more than their noise, the offset goes in a straight line from one to
    the other (a sensor that warms up).
    """
    rests: list[tuple[float, float, float]] = []
    for direction in (1, -1):
        rows = find_rest(time, rate, noise, direction)
        if rows is not None:
            still = rate[rows]
            rests.append((float(time[rows].mean()), float(still.mean()), _std_of_mean(time, still)))
    if len(rests) == 2:
        (t0, b0, s0), (t1, b1, s1) = rests
        if abs(b1 - b0) > 5 * np.hypot(s0, s1):
            return Bias(
                np.interp(time, (t0, t1), (b0, b1)), max(s0, s1), "from the rest at both ends, drifting"
            )
        weights = np.array((s0, s1)) ** -2.0
        value = float(np.average((b0, b1), weights=weights))
        return Bias(np.full(rate.size, value), float(weights.sum() ** -0.5), "from the rest at both ends")
    if rests:
        where = "beginning" if rests[0][0] < time[-1] / 2 else "end"
        return Bias(np.full(rate.size, rests[0][1]), rests[0][2], f"from the rest at the {where}")
    level = oscillation_level(rate)
    if level is None:
        return Bias(np.zeros(rate.size), np.inf, "(unknown)")
    return Bias(np.full(rate.size, level[0]), level[1], "from the oscillation itself: the log has no rest")


def find_rest(time: Array, rate: Array, noise: float, direction: int) -> slice | None:
    """Return the rows at the beginning (direction 1) or the end (-1) in which a gyro shows noise alone, if any."""
    size = max(16, round(REST_BLOCK / float(np.median(np.diff(time)))))
    ordered = rate[::direction]
    blocks = ordered[: ordered.size // size * size].reshape(-1, size)
    if not len(blocks):
        return None
    means = blocks.mean(axis=1)
    limit = 2.5 * noise
    quiet = (blocks.std(axis=1) < limit) & (np.abs(means - means[0]) < limit)
    count = len(blocks) if quiet.all() else int(np.argmin(quiet))
    if count in (0, len(blocks)) or abs(means[0]) > 0.3 * np.abs(rate).max():
        return None
    return slice(0, count * size) if direction == 1 else slice(rate.size - count * size, rate.size)


def _std_of_mean(time: Array, still: Array) -> float:
    """Standard deviation of the mean of a still stretch: neighbouring blocks tell how far it really wanders."""
    size = max(16, round(REST_BLOCK / float(np.median(np.diff(time)))))
    means = still[: still.size // size * size].reshape(-1, size).mean(axis=1)
    wander = float(means.std(ddof=1)) / np.sqrt(means.size) if means.size > 2 else 0.0
    return max(float(still.std()) / np.sqrt(still.size), wander, 1e-12)


def resting_level(angle: Array) -> float:
    """Return the rest angle: where a quiet end lies, else what the oscillation is about, else the median."""
    tail = angle[-max(8, angle.size // 20) :]
    if np.ptp(tail) < 0.02 * np.ptp(angle):
        return float(np.mean(tail))
    level = oscillation_level(angle)
    return float(np.median(angle)) if level is None else level[0]


def oscillation_level(signal: Array) -> tuple[float, float] | None:
    """Return the level that a decaying oscillation is about, and its standard deviation; None if there is none.

    A decaying sine about a level c satisfies y(t + 2m) = a y(t + m) + b y(t) + (1 - a - b) c for any lag m
    (Prony); least squares over the record, with m a quarter of the period, gives c.
    """
    centred = signal - np.mean(signal)
    crossings = np.flatnonzero(np.diff(np.signbit(centred)))
    spans = np.diff(crossings)
    long = spans[spans > 0.3 * spans.max()] if spans.size else spans
    if long.size < 2:
        return None
    lag = max(1, int(np.median(long) / 2))
    if signal.size < 6 * lag:
        return None
    design = np.stack((signal[lag:-lag], signal[: -2 * lag], np.ones(signal.size - 2 * lag)), axis=1)
    target = signal[2 * lag :]
    solution, *_ = np.linalg.lstsq(design, target, rcond=None)
    gain = float(1 - solution[0] - solution[1])
    residual = float(np.std(target - design @ solution))
    # Residuals are alike over about a lag: that many fewer of them are independent.
    std = residual / max(gain, 1e-9) * np.sqrt(lag / target.size)
    level = float(solution[2]) / gain if gain > 0.1 else np.inf
    return (level, std) if abs(level - np.mean(signal)) < np.ptp(signal) / 2 else None
