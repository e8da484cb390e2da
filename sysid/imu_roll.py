"""Roll from an inertial sensor: a rate gyro alone, gyro and accelerometer, or an orientation quaternion."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.log_clock import Clock
from sysid.log_columns import Choice
from sysid.log_names import RATE_UNITS
from sysid.log_noise import estimate_noise, saturated
from sysid.roll import Array, Roll

if TYPE_CHECKING:
    from sysid.logs import LogOptions

REST_BLOCK = 0.2
"""Length of a stretch that is tested for rest [s]."""
MAX_RATE = 35.0
"""No common gyro measures more than 2000 °/s = 34.9 rad/s: larger numbers are degrees."""


@dataclass(frozen=True, slots=True)
class Bias:
    """Offset of a rate gyro."""

    value: Array
    """Offset at each sample [rad/s], shape (n,)."""
    std: float
    """Standard deviation of its mean [rad/s]; inf where nothing tells it."""
    how: str


def roll_from_imu(
    path: Path, choice: Choice, clock: Clock, data: dict[str, Array], options: "LogOptions"
) -> Roll:
    """Return roll from the chosen columns of an inertial sensor.

    Raises:
        HuskyError: The sensor did not move, or gravity lies along the roll axis.
    """
    rates = np.stack([data[name] for name in choice.columns[:3]], axis=1)
    rates = rates * rate_scale(rates, choice)
    return roll_from_rate(path, choice, clock, rates[:, 0] * choice.sign)


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
    if excess.any():
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


def rate_scale(rates: Array, choice: Choice) -> float:
    """Return rad/s per unit of the rates, shape (n, m), adding to the choice's notes how that is known."""
    if choice.scale is not None:
        choice.notes.append(f"one count is {choice.scale:g} rad/s, as --unit says")
        return choice.scale
    if choice.unit is not None:
        return RATE_UNITS[choice.unit]
    largest = float(np.abs(rates).max())
    unit = "deg/s" if largest > MAX_RATE else "rad/s"
    choice.warnings.append(
        f"'{choice.columns[0]}' names no unit; taken as {unit}, because it reaches {largest:.3g}. "
        "That can be wrong: say it with --unit"
    )
    return RATE_UNITS[unit]


def estimate_bias(time: Array, rate: Array, noise: float) -> Bias:
    """Find a gyro's offset from the rest at the beginning and the end, or else from the oscillation.

    Where both ends rest and differ by more than their noise, the offset goes in a straight line from one to
    the other (a sensor that warms up).
    """
    rests = [rest for rest in (_rest(time, rate, noise, 1), _rest(time, rate, noise, -1)) if rest is not None]
    if len(rests) == 2 and rests[0][0] < rests[1][0]:
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


def _rest(time: Array, rate: Array, noise: float, direction: int) -> tuple[float, float, float] | None:
    """Return time, mean rate and its standard deviation of the rest at one end of the log, if there is one."""
    period = float(np.median(np.diff(time)))
    size = max(16, round(REST_BLOCK / period))
    ordered = rate[::direction]
    blocks = ordered[: ordered.size // size * size].reshape(-1, size)
    if not len(blocks):
        return None
    means = blocks.mean(axis=1)
    limit = 2.5 * noise
    quiet = (blocks.std(axis=1) < limit) & (np.abs(means - means[0]) < limit)
    count = int(np.argmin(quiet)) if not quiet.all() else len(blocks)
    if count == 0 or (count == len(blocks)) or abs(means[0]) > 0.3 * np.abs(rate).max():
        return None
    still = ordered[: count * size]
    middle = time[::direction][count * size // 2]
    # Neighbouring blocks tell how far the mean really wanders, which white noise alone does not.
    wander = means[:count].std(ddof=1) / np.sqrt(count) if count > 2 else 0.0
    return float(middle), float(still.mean()), float(max(still.std() / np.sqrt(still.size), wander, 1e-12))
