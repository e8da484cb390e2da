"""Logs in: any file that holds a rocking board becomes one `Roll`.

What is inferred (column, unit, axis, clock) is written into `Roll.notes`, what is wrong with the log into
`Roll.warnings`, and every inference can be overridden by `LogOptions`.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from sysid.errors import HuskyError
from sysid.logs.formats.registry import open_log
from sysid.logs.table.choose import Choice, angle_scale, choose_columns
from sysid.logs.table.clock import Clock, even_clock, repair_clock, usual_step
from sysid.noise.sensor import estimate_noise, saturated
from sysid.roll import Array, Roll
from sysid.video.options import VideoOptions, is_film

MIN_SAMPLES = 8
LARGEST, LARGEST_STAMP = 1e12, 1e21
"""Beyond these a signal or a time stamp is damage, not a number; nanoseconds since 1970 are 1.8e18."""
Source = Literal["auto", "angle", "gyro", "imu", "quaternion"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LogOptions:
    """What the user says about a log instead of leaving it to inference."""

    column: str | None = None
    """The column to read roll from: its name, or its number counted from 1."""
    unit: str | None = None
    """The column's unit ('deg', 'rad/s', ...), or the size of one count in rad (or rad/s for a rate)."""
    axis: str | None = None
    """The sensor axis that points forward: 'x', '-y', ...; for angles also 'roll', 'pitch', 'yaw'."""
    rate: float | None = None
    """Sampling rate [Hz]: replaces the time column."""
    time_column: str | None = None
    """The column of time: its name, or its number counted from 1."""
    source: Source = "auto"
    """What to make roll from, where a log holds several."""
    lever_arm: tuple[float, float, float] | None = None
    """From the tilt axis to the accelerometer, in sensor axes [m]; None estimates it."""
    video: VideoOptions | None = None
    """How a film is read; its `rate` is the one above."""


def read_roll(path: Path, options: LogOptions | None = None) -> Roll:
    """Read any log or film as roll against time.

    Raises:
        HuskyError: The file cannot be read, holds no roll, or holds too little to be a measurement.
    """
    options = options or LogOptions()
    if options.rate is not None and not 0 < options.rate < np.inf:
        raise HuskyError(f"--rate {options.rate}: a sampling rate is a positive number of hertz.")
    if not path.exists():
        raise HuskyError(f"{path}: there is no such file.")
    if is_film(path):
        from sysid.video_roll import roll_from_video

        return roll_from_video(path, replace(options.video or VideoOptions(), rate=options.rate))
    log = open_log(path)
    choice = choose_columns(log, options)
    data = log.read([name for name in (*choice.columns, choice.time, choice.std) if name])
    try:
        clock, data = _clean(choice, data, options)
        if choice.source == "angle":
            roll = _roll_from_angle(path, choice, clock, data)
        else:
            from sysid.logs.sources.imu import roll_from_imu

            roll = roll_from_imu(path, choice, clock, data, options)
        roll = _checked(roll)
    except HuskyError as error:
        raise HuskyError(f"{path}: {error}") from None
    rate = 1 / usual_step(roll.time)
    sampling = f"{roll.time.size} samples in {roll.time[-1]:.4g} s at {rate:.4g} Hz"
    return replace(roll, notes=(*log.notes, *choice.notes, *clock.notes, sampling, *roll.notes))


def _clean(choice: Choice, data: dict[str, Array], options: LogOptions) -> tuple[Clock, dict[str, Array]]:
    """Drop rows without numbers and repair the clock; the returned columns have the clock's rows."""
    stamps = data.pop(choice.time) if choice.time else None
    signals = [data[name] for name in choice.columns]
    rows = signals[0].size
    limits = [
        *((column, LARGEST) for column in signals),
        *(() if stamps is None else ((stamps, LARGEST_STAMP),)),
    ]
    kept = _sound_rows(limits) if rows else None
    count = rows if kept is None else kept.size
    if count < MIN_SAMPLES:
        raise HuskyError(
            f"{count} of {rows} rows hold numbers in {', '.join(map(repr, choice.columns))}; "
            f"at least {MIN_SAMPLES} are needed. Is it the right file and column?"
        )
    if kept is not None:
        data = {name: column[kept] for name, column in data.items()}
        stamps = stamps if stamps is None else stamps[kept]
    liveliest = data[max(choice.columns, key=lambda name: float(np.std(data[name][:200_000])))]
    if liveliest.min() == liveliest.max():
        raise HuskyError(
            f"{', '.join(map(repr, choice.columns))} never changes (always {liveliest[0]:g}): the sensor was dead, "
            "or it is the wrong column. Name another with --column."
        )
    if stamps is None:
        clock = even_clock(rows, options.rate or 1.0, kept)
    else:
        clock = repair_clock(
            stamps, liveliest, choice.time_unit, choice.time or "", computed=choice.std is not None
        )
    if kept is not None:
        clock.warnings.append(f"{rows - count} of {rows} rows without a number in them: dropped")
    return clock, {name: clock.of(column) for name, column in data.items()}


def _sound_rows(limits: list[tuple[Array, float]]) -> npt.NDArray[np.intp] | None:
    """Return the rows in which every column is a number within its limit; None if all are."""
    # One pass without a copy for the usual case; NaN makes both comparisons false.
    if all(-limit < column.min() and column.max() < limit for column, limit in limits):
        return None
    sound = np.ones(limits[0][0].size, dtype=np.bool_)
    for column, limit in limits:
        sound &= np.abs(column) < limit
    return np.flatnonzero(sound)


def _checked(roll: Roll) -> Roll:
    """Return a roll that computing with is safe for, with no standard deviation below rounding.

    Raises:
        HuskyError: It does not move, or overflowed.
    """
    reach = float(np.ptp(roll.roll))
    if not np.isfinite(reach) or not np.diff(roll.time).min() > 0:
        raise HuskyError(
            "its numbers are too large or too close to compute with. Is the unit right? See --unit, --rate."
        )
    if reach == 0:
        raise HuskyError("roll never changes about this axis. Choose another with --axis or --column.")
    smallest = 1e-9 * reach
    return roll if roll.std.min() >= smallest else replace(roll, std=np.maximum(roll.std, smallest))


def _roll_from_angle(path: Path, choice: Choice, clock: Clock, data: dict[str, Array]) -> Roll:
    """Scale, unwrap and weigh an angle column."""
    (name,) = choice.columns
    angle = data[name]
    scale = angle_scale(angle, choice, name)
    factor = scale * choice.sign
    roll = _unwrapped(angle if factor == 1 else angle * factor, choice)
    noise = estimate_noise(roll)
    if choice.std is not None and np.all(data[choice.std] > 0):
        std = data[choice.std] * abs(scale)
        choice.notes.append(f"standard deviation from '{choice.std}'")
    else:
        std = np.full(roll.size, noise.std)
        step = f", quantised in steps of {np.rad2deg(noise.step):.3g}°" if noise.step > noise.std else ""
        choice.notes.append(f"sensor noise {np.rad2deg(noise.std):.3g}° from the signal itself{step}")
    excess = saturated(roll, noise)
    if excess is not None:
        np.maximum(std, excess, out=std)
        choice.warnings.append(
            f"'{name}' is saturated in {np.count_nonzero(excess)} samples (at {np.rad2deg(roll.min()):.3g}° or "
            f"{np.rad2deg(roll.max()):.3g}°): they count for little, and amplitudes near there are lower bounds"
        )
    return Roll(
        log=str(path),
        time=clock.time,
        roll=roll,
        std=std,
        origin="angle",
        warnings=(*clock.warnings, *choice.warnings),
    )


def _unwrapped(roll: Array, choice: Choice) -> Array:
    """Undo jumps of a whole turn, and bring the middle of the record into ±half a turn."""
    turn = 2 * np.pi
    if np.ptp(roll) > 0.75 * turn:
        steps = np.diff(roll)
        jumps = np.flatnonzero(np.abs(steps) > 0.75 * turn)
        if jumps.size:
            turns = np.zeros(roll.size)
            turns[jumps + 1] = -np.round(steps[jumps] / turn)
            roll = roll + np.cumsum(turns) * turn
            choice.notes.append(f"angle wrapped by a whole turn {jumps.size} times: unwrapped")
    whole = float(np.round(np.median(roll[:: max(1, roll.size // 100_000)]) / turn))
    if whole:
        roll = roll - whole * turn
        choice.notes.append(f"{whole:+g} whole turns taken off")
    return roll
