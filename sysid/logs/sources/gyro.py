"""Roll from a rate gyro alone: its unit, its offset, and the integral."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.errors import SysidError
from sysid.logs.sources.axis import find_roll_axis
from sysid.logs.sources.registry import LENGTHS, Reading, Source
from sysid.logs.sources.swing_smoother import integral_of
from sysid.logs.table.choose import Choice, chosen, triple
from sysid.logs.table.names import RATE_UNITS, Column, unit_kind
from sysid.logs.table.noise import noise_of
from sysid.logs.table.remarks import Remarks, note, warning
from sysid.noise.sensor import clipped_rows
from sysid.roll import Array, Roll

REST_BLOCK = 0.2
"""Length of a stretch that is tested for rest [s]: longer than a period of the shipped decks, so that a part of a
swing cannot pass. Half or twice of it moves the offset of the shipped log by 1e-4 rad/s, its own uncertainty."""
MAX_RATE = 35.0
"""No common gyro measures more than 2000 °/s = 34.9 rad/s: larger numbers are degrees [rad/s]."""


@dataclass(frozen=True, slots=True)
class Bias:
    """Offset of a rate gyro."""

    value: Array
    """Offset at each sample [rad/s], shape (n,)."""
    std: float
    """Standard deviation of its mean [rad/s]; inf where nothing tells it."""
    how: str


def find_gyro(columns: Sequence[Column], axis: str, sign: float) -> list[Choice]:
    """Return the three rates of one gyro, or else the one rate whose name is the plainest."""
    gyro = triple(columns, "rate", "xyz")
    if gyro is not None:
        return [chosen(gyro, axis, sign, f"from gyro '{gyro[0].name}'..., integrated")]
    rates = [c for c in columns if c.kind == "rate" and (not axis or (c.axis or "x") == axis)]
    if not rates:
        return []
    rates.sort(key=lambda c: (c.doubt, c.axis in ("y", "z"), not c.is_roll, c.unit is None))
    return [chosen(rates[:1], "", sign, f"from the rate '{rates[0].name}', integrated")]


def gyro_from(column: Column, columns: Sequence[Column], sign: float) -> Choice:
    """Return one column that the user names, as a rotation rate."""
    unit = column.unit if unit_kind(column.unit) in ("rate", "speed") else None
    choice = chosen([column], "", sign, f"from the rate '{column.name}', integrated")
    return replace(choice, unit=unit, doubt=0)


def roll_from_gyro(reading: Reading) -> Roll:
    """Return the integral of one rate, or of the part of three rates about the roll axis."""
    choice = reading.choice
    rates = np.stack(reading.signals, axis=1)
    scale, remarks = rate_scale(rates, choice)
    rates = rates * scale
    if rates.shape[1] == 1:
        roll = roll_from_rate(reading, rates[:, 0] * choice.sign, remarks)
        return replace(roll, origin="speed") if choice.unit in LENGTHS["rate"] else roll
    axis = find_roll_axis(rates, choice)
    return roll_from_rate(reading, rates @ axis.vector, remarks + axis.remarks)


def gyro_turning(choice: Choice, signals: Sequence[Array], period: float) -> Array:
    """Return the rate about the axis of most rotation [rad/s], shape (n,)."""
    rates = np.stack(signals, axis=1)
    rates = (rates - np.median(rates, axis=0)) * _likely_scale(rates, choice)[0]
    return rates @ np.linalg.eigh(rates.T @ rates)[1][:, -1]


def rate_scale(rates: Array, choice: Choice) -> tuple[float, Remarks]:
    """Return rad/s per unit of the rates, shape (n, m), and how that is known.

    Raises:
        SysidError: No unit is named, and they are counts.
    """
    largest = float(np.abs(rates).max())
    silent = choice.unit is None and choice.scale is None
    if silent and largest * RATE_UNITS["deg/s"] > MAX_RATE and np.all(rates == np.rint(rates)):
        raise SysidError(
            f"'{choice.columns[0]}' names no unit, and its whole numbers up to {largest:.0f} look like counts of a gyro. Give "
            f"the size of one in rad/s: --unit {250 * RATE_UNITS['deg/s'] / 2**15:.4g} where 16 bits are ±250 deg/s."
        )
    return _likely_scale(rates, choice)


def _likely_scale(rates: Array, choice: Choice) -> tuple[float, Remarks]:
    if choice.unit in LENGTHS["rate"]:
        return LENGTHS["rate"][choice.unit], note(
            "unit", f"'{choice.columns[0]}' is the speed of a slide in {choice.unit}"
        )
    if choice.scale is not None:
        return choice.scale, note("unit", f"one count is {choice.scale:g} rad/s, as --unit says")
    if choice.unit is not None:
        return RATE_UNITS[choice.unit], Remarks()
    largest = float(np.abs(rates).max())
    unit = "deg/s" if largest > MAX_RATE else "rad/s"
    return RATE_UNITS[unit], warning(
        f"'{choice.columns[0]}' names no unit; taken as {unit}, because it reaches {largest:.3g}. "
        "Check the unit; --unit sets another"
    )


def roll_from_rate(reading: Reading, rate: Array, remarks: Remarks) -> Roll:
    """Integrate one rotation rate [rad/s], shape (n,), to roll.

    The zero of roll is the rest angle, as far as the record shows it: a gyro knows no vertical. The error of
    the integral is a random walk; fits should use `Roll.rate`, whose errors are independent.
    """
    time = reading.time
    noise, counted = noise_of(time, rate), reading.counted
    bias = estimate_bias(time[counted], rate[counted], noise.std)
    free = rate - np.interp(time, time[counted], bias.value)
    steps = np.diff(time)
    angle = np.asarray(integral_of(time, free)(time), np.float64)
    angle -= resting_level(angle[counted])
    walk = noise.std * np.sqrt(np.cumsum(np.concatenate((steps[:1], steps))) * np.median(steps))
    rate_std = np.full(rate.size, noise.std)
    clipped = clipped_rows(rate, noise)
    if clipped.any():
        remarks += warning(
            f"the gyro is saturated at {np.abs(rate[clipped]).max():.3g} rad/s in {np.count_nonzero(clipped)} "
            "samples: left out, and angles after them are off; use a range that is wide enough"
        )
    if not np.isfinite(bias.std):
        remarks += warning(
            "no rest and no oscillation to find the gyro's offset from: taken as 0, roll may drift"
        )
    remarks += note("offset", f"{np.mean(bias.value):.3g} rad/s ± {bias.std:.1g} {bias.how}")
    remarks += note("noise", f"{noise.std:.2g} rad/s of the gyro")
    remarks += note("zero", "at rest: a gyro knows no vertical")
    std = np.maximum(walk, noise.std * float(np.median(steps)))
    kept = ~clipped
    return replace(reading, time=time[kept]).as_roll(
        angle[kept], std[kept], "gyro", remarks, zero="drifting", measured="rate", rate=free[kept],
        rate_std=rate_std[kept],
    )  # fmt: skip


def estimate_bias(time: Array, rate: Array, noise: float) -> Bias:
    """Find a gyro's offset from the rest at the beginning and the end, or else from the oscillation.

    If both ends rest and differ by more than their noise, the offset is a line from one to the other: the sensor
    warms up. Times [s] and rates [rad/s] are of shape (n,), the noise is that of a sample [rad/s].
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
            line = np.interp(time, (t0, t1), (b0, b1))
            return Bias(line, max(s0, s1), "from the rest at both ends, drifting")
        weights = np.array((s0, s1)) ** -2.0
        value = float(np.average((b0, b1), weights=weights))
        return Bias(np.full(rate.size, value), float(weights.sum() ** -0.5), "from the rest at both ends")
    if rests:
        where = "beginning" if rests[0][0] < 0.5 * (time[0] + time[-1]) else "end"
        return Bias(np.full(rate.size, rests[0][1]), rests[0][2], f"from the rest at the {where}")
    level = oscillation_level(rate)
    if level is None:
        return Bias(np.zeros(rate.size), np.inf, "(unknown)")
    return Bias(np.full(rate.size, level[0]), level[1], "from the oscillation itself: the log has no rest")


def find_rest(time: Array, rate: Array, noise: float, direction: int) -> slice | None:
    """Return the rows at the beginning (direction 1) or the end (-1) in which a gyro shows noise alone, if any.

    Times [s] and rates [rad/s] are of shape (n,), the noise is the standard deviation of a sample [rad/s].
    """
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
    if count * size < half_cycle(rate):
        return None  # a slow swing stands as still where its rate is largest
    return slice(0, count * size) if direction == 1 else slice(rate.size - count * size, rate.size)


def half_cycle(rate: Array) -> float:
    """Return how many rows a half cycle of a rate [rad/s], shape (n,), takes where it is large."""
    swing = rate - np.median(rate)
    side = np.where(np.abs(swing) > 0.2 * np.abs(swing).max(), np.sign(swing), 0.0)
    edges = np.flatnonzero(np.diff(side, prepend=0.0, append=0.0))
    lengths = np.diff(edges)[side[edges[:-1]] != 0]
    # A sine is beyond a fifth of its amplitude for 87 % of a half cycle. Noise at that edge makes runs of a row or two.
    return float(np.median(lengths[lengths > 2])) / 0.87 if np.any(lengths > 2) else 0.0


def _std_of_mean(time: Array, still: Array) -> float:
    """Standard deviation of the mean of a still stretch: neighbouring blocks tell how far it really wanders."""
    size = max(16, round(REST_BLOCK / float(np.median(np.diff(time)))))
    means = still[: still.size // size * size].reshape(-1, size).mean(axis=1)
    wander = float(means.std(ddof=1)) / np.sqrt(means.size) if means.size > 2 else 0.0
    return max(float(still.std()) / np.sqrt(still.size), wander, 1e-12)


def resting_level(angle: Array) -> float:
    """Return the rest angle of a swing [rad], shape (n,): where a quiet end lies, else what the oscillation is about, else the median."""
    tail = angle[-max(8, angle.size // 20) :]
    if np.ptp(tail) < 0.02 * np.ptp(angle):
        return float(np.mean(tail))
    level = oscillation_level(angle)
    return float(np.median(angle)) if level is None else level[0]


def oscillation_level(signal: Array) -> tuple[float, float] | None:
    """Return the level that a decaying oscillation is about, and its standard deviation; None without an oscillation.

    A decaying sine about a level c satisfies y(t + 2m) = a y(t + m) + b y(t) + (1 - a - b) c for any lag m (Prony).
    Least squares with m a quarter of the period gives c.

    Args:
        signal: In any unit, shape (n,).
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


SOURCE = Source(
    name="gyro",
    order=2,
    quantity="rate",
    find=find_gyro,
    to_roll=roll_from_gyro,
    moving=3,
    turning=gyro_turning,
    from_column=gyro_from,
)
