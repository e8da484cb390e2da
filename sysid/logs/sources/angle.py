"""Roll from an angle: an encoder, or what a fusion filter has made of its sensors."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.errors import SysidError
from sysid.logs.sources.registry import LENGTHS, Reading, Source, known_scale
from sysid.logs.table.choose import Choice, chosen, std_of
from sysid.logs.table.names import ANGLE_UNITS, Column, says_counts
from sysid.logs.table.noise import noise_of
from sysid.logs.table.remarks import Remarks, note, warning
from sysid.noise.sensor import saturated
from sysid.roll import Array, Roll
from sysid.text import display

TURNS = {unit: 2 * np.pi / ANGLE_UNITS[unit] for unit in ("deg", "rad")}
"""A whole turn by unit. Angles that count on over a turn in whole numbers are counts, for degrees begin again."""


def find_angle(columns: Sequence[Column], axis: str, sign: float) -> list[Choice]:
    """Return the angles, about an axis if one is given, the one whose name is the plainest first."""
    quaternions = {
        c.group for c in columns if c.kind == "angle" and c.axis == "w"
    }  # no angle has a fourth axis
    angles = [
        c for c in columns
        if c.kind == "angle" and c.group not in quaternions and (not axis or (c.axis or "x") == axis)
    ]  # fmt: skip

    def odd(column: Column) -> tuple[object, ...]:
        return column.doubt, not axis and column.axis in ("y", "z"), not column.is_roll

    def rank(column: Column) -> tuple[object, ...]:
        return *odd(column), column.unit != "rad", column.unit is None, len(column.name)

    angles.sort(key=rank)
    choices = [
        chosen([column], "", sign, f"from '{column.name}'", std=std_of(column, columns)) for column in angles
    ]
    if len(angles) > 1:
        rivals = ", ".join(repr(column.name) for column in angles[1:5])
        alike = tuple(column.name for column in angles[1:] if odd(column) == odd(angles[0]))
        rather = note("signal", f"from '{angles[0].name}' rather than {rivals}")
        choices[0] = replace(choices[0], remarks=rather, rivals=alike)
    if angles and not axis and angles[0].axis in ("y", "z"):
        aside = f"'{angles[0].name}' is the only angle and taken as roll, though its name says otherwise"
        choices[0] = choices[0].with_remarks(warning(aside))
    return choices


def angle_from(column: Column, columns: Sequence[Column], sign: float) -> Choice:
    """Return one column that the user names, as an angle."""
    unit = column.unit if column.unit in (*ANGLE_UNITS, *LENGTHS["angle"]) else None
    choice = chosen([column], "", sign, f"from '{column.name}'", std=std_of(column, columns))
    return replace(choice, unit=unit, doubt=0)


def angle_scale(angle: Array, choice: Choice) -> tuple[float, Remarks]:
    """Return radians per unit of an angle, shape (n,), and how that is known.

    Raises:
        SysidError: No unit is named, and it is in whole numbers that go beyond a turn or whose name says that they are counts.
    """
    (name,) = choice.columns
    if known := known_scale(choice, "angle"):
        return known
    reach = _reach(angle)
    whole = bool(np.all(angle == np.rint(angle)))
    turn = TURNS["deg"]
    beyond = np.abs(angle).max() > turn or np.ptp(np.unwrap(angle, period=turn)) > turn
    if whole and (beyond or says_counts(name)):
        raise SysidError(
            f"'{name}' names no unit, and its whole numbers from {angle.min():.0f} to {angle.max():.0f} look like counts of "
            f"an encoder. Give the size of one in rad: --unit {2 * np.pi / 4096:.6g} where 4096 are a turn (2π/4096). "
            "Degrees are --unit deg."
        )
    unit = _likely_unit(reach)
    return ANGLE_UNITS[unit], warning(
        f"'{name}' names no unit; taken as {unit}, because it reaches {reach:.3g} from its median. Check the unit; --unit sets "
        "another"
    )


def unwrap_angle(choice: Choice, angle: Array) -> tuple[Choice, Array]:
    """Return an angle, shape (n,), without its jumps by a whole turn, which also tell its unit."""
    if choice.unit in LENGTHS["angle"]:
        return choice, angle  # a slide does not turn
    if choice.unit is None and choice.scale is None and (unit := _unit_by_wraps(angle)):
        told = f"'{choice.columns[0]}' names no unit; {unit}, because it jumps by {TURNS[unit]:.4g}"
        choice = replace(choice, unit=unit).with_remarks(note("unit", told))
    turn = 2 * np.pi / abs(choice.scale or ANGLE_UNITS[choice.unit or _likely_unit(_reach(angle))])
    unwrapped = np.unwrap(angle, period=turn)
    count = np.count_nonzero(np.diff(np.rint((unwrapped - angle) / turn)))
    if not count:
        return choice, angle
    return choice.with_remarks(note("angle", f"wrapped by a whole turn {count} times, unwrapped")), unwrapped


def _unit_by_wraps(angle: Array) -> str | None:
    """Return the unit in which an angle, shape (n,), stays within a whole turn and jumps by nearly one; None without."""
    largest = np.abs(np.diff(angle)).max()
    return next(
        (unit for unit, turn in TURNS.items() if 0.9 * turn < largest <= np.ptp(angle) < 1.02 * turn), None
    )


def _reach(angle: Array) -> float:
    """Return how far an angle, shape (n,), goes from its median, in its unit."""
    return float(np.max(np.abs(angle - np.median(angle))))


def _likely_unit(reach: float) -> str:
    """Return the unit of an angle that reaches so far from its median, no deck being tipped by half a turn."""
    return "deg" if reach > np.pi else "rad"


def roll_from_angle(reading: Reading) -> Roll:
    """Return an angle scaled, unwrapped and weighed."""
    choice, (angle,) = reading.choice, reading.signals
    scale, remarks = angle_scale(angle, choice)
    factor = scale * choice.sign
    roll = angle if factor == 1 else angle * factor
    slides = choice.unit in LENGTHS["angle"]
    show = display(is_rate=False, slides=slides)
    turns = 0.0 if slides else float(np.round(np.median(roll[:: max(1, roll.size // 100_000)]) / (2 * np.pi)))
    if turns:
        roll = roll - 2 * np.pi * turns
        remarks += note("angle", f"{turns:+g} whole turns taken off")
    noise = noise_of(reading.time, roll)
    if reading.std is not None and np.all(reading.std > 0):
        std = reading.std * abs(scale)
        remarks += note("noise", f"from the column '{choice.std}'")
    else:
        std = np.full(roll.size, noise.std)
        step = f", quantised in steps of {show(noise.step, 3)}" if noise.step > noise.std else ""
        remarks += note("noise", f"{show(noise.std, 3)} from the whole signal{step}")
    excess = saturated(roll, noise)
    if excess is not None:
        np.maximum(std, excess, out=std)
        remarks += warning(
            f"'{choice.columns[0]}' is saturated in {np.count_nonzero(excess)} samples (at {show(roll.min(), 3)} or "
            f"{show(roll.max(), 3)}): they count for little, and amplitudes near there are lower bounds"
        )
    return reading.as_roll(roll, std, "position" if slides else "angle", remarks, unit_size=factor)


SOURCE = Source(
    name="angle",
    order=0,
    quantity="angle",
    find=find_angle,
    to_roll=roll_from_angle,
    moving=1,
    unwrap=unwrap_angle,
    compared=True,
    from_column=angle_from,
)
