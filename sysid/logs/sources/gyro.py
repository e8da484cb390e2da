"""Roll from a rate gyro alone: its unit, its offset, and the integral."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.errors import SysidError
from sysid.logs.sources.axis import find_roll_axis
from sysid.logs.sources.registry import LENGTHS, Reading, Source, known_scale
from sysid.logs.sources.swing_smoother import PER_SWING, ROUNDS, integral_of
from sysid.logs.table.choose import Choice, chosen, triple
from sysid.logs.table.names import MAX_RATE, RATE_UNITS, Column, unit_kind
from sysid.logs.table.noise import noise_of
from sysid.logs.table.remarks import Remarks, note, warning
from sysid.noise.sensor import clipped_rows
from sysid.quantity import Z95
from sysid.roll import Array, Roll


def find_gyro(columns: Sequence[Column], axis: str, sign: float) -> list[Choice]:
    """Return the three rates of one gyro, or else single rates, the one whose name is the plainest first."""
    gyro = triple(columns, "rate", "xyz")
    if gyro is not None:
        return [chosen(gyro, axis, sign, f"from gyro '{gyro[0].name}'..., integrated")]
    rates = [c for c in columns if c.kind == "rate" and (not axis or (c.axis or "x") == axis)]

    def odd(column: Column) -> tuple[object, ...]:
        return column.doubt, column.axis in ("y", "z"), not column.is_roll

    rates.sort(key=lambda c: (*odd(c), c.unit is None))
    alike = tuple(c.name for c in rates[1:] if odd(c) == odd(rates[0]))
    return [
        replace(chosen([c], "", sign, f"from the rate '{c.name}', integrated"), rivals=alike) for c in rates
    ]


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
    axis, how_axis = find_roll_axis(rates, choice)
    return roll_from_rate(reading, rates @ axis, remarks + how_axis)


def rate_scale(rates: Array, choice: Choice) -> tuple[float, Remarks]:
    """Return rad/s per unit of the rates, shape (n, m), and how that is known.

    Raises:
        SysidError: No unit is named, and they are counts.
    """
    if known := known_scale(choice, "rate"):
        return known
    largest = float(np.abs(rates).max())
    if largest * RATE_UNITS["deg/s"] > MAX_RATE and np.all(rates == np.rint(rates)):
        raise SysidError(
            f"'{choice.columns[0]}' names no unit, and its whole numbers up to {largest:.0f} look like counts of a gyro. Give "
            f"the size of one in rad/s: --unit {250 * RATE_UNITS['deg/s'] / 2**15:.4g} where 16 bits are ±250 deg/s."
        )
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
    offset, offset_std = level_of(time[counted], rate[counted])
    free = rate - np.interp(time, time[counted], offset)
    steps = np.diff(time)
    angle = np.asarray(integral_of(time, free)(time), np.float64)
    late = slice(time[counted].size // 2, None)  # holds before a release are not the rest
    rest, rest_std = level_of(time[counted][late], angle[counted][late])
    angle -= np.mean(rest) if np.isfinite(rest_std) else np.median(angle[counted])
    walk = noise.std * np.sqrt(np.cumsum(np.concatenate((steps[:1], steps))) * np.median(steps))
    kept = ~clipped_rows(rate, noise)
    if not kept.all():
        remarks += warning(
            f"the gyro is saturated at {np.abs(rate[~kept]).max():.3g} rad/s in {np.count_nonzero(~kept)} "
            "samples: left out, and angles after them are off; use a range that is wide enough"
        )
    if not np.isfinite(offset_std):
        remarks += warning("neither rest nor swing shows the gyro's offset: taken as 0, roll may drift")
    drift = offset[-1] - offset[0]
    shown = f", drifting by {drift:.2g} rad/s" if drift else ""
    remarks += note(
        "offset", f"{np.mean(offset):.3g} rad/s ± {offset_std:.1g} from rest and oscillation{shown}"
    )
    remarks += note("noise", f"{noise.std:.2g} rad/s of the gyro")
    remarks += note("zero", "at rest: a gyro knows no vertical")
    std = np.maximum(walk, noise.std * float(np.median(steps)))
    return replace(reading, time=time[kept]).as_roll(
        angle[kept], std[kept], "gyro", remarks, zero="drifting", measured="rate", rate=free[kept],
        rate_std=np.full(rate.size, noise.std)[kept],
    )  # fmt: skip


def level_of(time: Array, signal: Array) -> tuple[Array, float]:
    """Return the level that a signal swings about or rests on, shape (n,), and the standard deviation of its mean; 0 and inf if unknown.

    It is constant, or else a line in time where chance does not explain the slope.

    Args:
        time: [s], shape (n,).
        signal: In any unit, shape (n,).
    """
    line, std = _line_of(time, signal, slope=True)
    # The ends of a line over the log differ by √12 times the standard deviation of its mean, by chance.
    steep = abs(line[-1] - line[0]) > Z95 * np.sqrt(12) * std
    return (line, std) if steep else _line_of(time, signal, slope=False)


def _line_of(time: Array, signal: Array, *, slope: bool) -> tuple[Array, float]:
    """Return the same, with a slope or without.

    A decaying sine about a level c, and rest at c, obey `y(t + 2m) = a y(t + m) + b y(t) + (1 - a - b) c` for any lag m
    (Prony). With m a quarter of the period, robust least squares gives c as a line in time. Hands and pushes do not obey it, and count
    for next to nothing.
    """
    quarter = half_cycle(signal) / 2
    rows = max(1, int(4 * quarter / PER_SWING))  # averaged: noise, and hardly anything of the swing
    lag, count = max(1, round(quarter / rows)), signal.size // rows
    if count < 6 * lag:
        return np.zeros(signal.size), np.inf
    values, since = (
        x[: count * rows].reshape(count, rows).mean(axis=1) for x in (signal, time - time.mean())
    )
    columns = (values[lag:-lag], values[: -2 * lag], np.ones(count - 2 * lag), since[2 * lag :] * slope)
    design = np.stack(columns, axis=1)
    target = values[2 * lag :]
    solution, left = np.zeros(4), np.ones(target.size)
    for step in range(2 * ROUNDS):
        usual = float(np.median(left)) or 1e-300
        # The least sum of logarithms is blind to hands; from there Cauchy's weights make use of nearly all that is free.
        weight = 1 / np.maximum(left, usual) if step < ROUNDS else 1 / np.hypot(1, left / (4.5 * usual))
        solution = np.linalg.lstsq(design * weight[:, None], target * weight, rcond=None)[0]
        left = np.abs(target - design @ solution)
    gain = float(1 - solution[0] - solution[1])
    level = (solution[2] + solution[3] * (time - time.mean())) / max(gain, 1e-9)
    if not abs(np.mean(level) - np.mean(signal)) < np.ptp(signal) / 2:
        return np.zeros(signal.size), np.inf
    # 1.5 medians are the standard deviation of a normal variable. Residuals are alike over about a lag: that many fewer of them are
    # independent. In white noise the result is twice the scatter of the level.
    return level, 1.5 * float(np.median(left)) / gain * np.sqrt(lag / target.size)


def half_cycle(rate: Array) -> float:
    """Return how many rows a half cycle of a rate [rad/s], shape (n,), takes where it is large."""
    swing = rate - np.median(rate)
    side = np.where(np.abs(swing) > 0.2 * np.abs(swing).max(), np.sign(swing), 0.0)
    edges = np.flatnonzero(np.diff(side, prepend=0.0, append=0.0))
    lengths = np.diff(edges)[side[edges[:-1]] != 0]
    # A sine is beyond a fifth of its amplitude for 87 % of a half cycle. Noise at that edge makes runs of a row or two.
    return float(np.median(lengths[lengths > 2])) / 0.87 if np.any(lengths > 2) else 0.0


SOURCE = Source(
    name="gyro",
    order=2,
    quantity="rate",
    find=find_gyro,
    to_roll=roll_from_gyro,
    moving=3,
    compared=True,
    from_column=gyro_from,
)
