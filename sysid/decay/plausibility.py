"""Plausibility checks: angles and numbers that point to a wrong unit, another board or a wrong model."""

import math
from collections.abc import Sequence

from sysid.board import Board
from sysid.decay.numbers import DecayNumbers
from sysid.errors import SysidError
from sysid.quantity import SURE
from sysid.roll import Release, shown
from sysid.text import display

WORTH_SAYING = 0.03
"""Least relative difference from the record: boards change by as much from day to day."""
LONGEST, SHORTEST = 100.0, 1e-3
"""Range of the natural periods of all joints [s]."""


def amplitude_warnings(releases: Sequence[Release], board: Board | None) -> list[str]:
    """Compare the amplitudes of some releases with the range of the board's joint; without a board, with half a turn.

    Returns:
        Warnings, one at most.

    Raises:
        SysidError: The deck was let go from more than half a turn, or the log is of a joint of another kind.
    """
    largest = max(releases, key=lambda release: release.amplitude)
    where = f"{largest.log}: the release at {shown(largest.start)} starts"
    if board is None:  # a warning only: a torsion rig may turn so far
        turned = f"{where} {math.degrees(largest.amplitude):.4g}° from rest, more than half a turn: is the unit right (--unit)?"
        return [turned] if largest.amplitude > math.pi else []
    limit, show = board.tilt["range"].value, display(is_rate=False, slides=board.slides)
    if largest.origin == "position" and not board.slides:
        raise SysidError(
            f"{largest.log}: is the position of a slide, but the joint of board '{board.name}' turns. If it is an angle, give its "
            "unit (--unit rad); else name the joint that slides (--model, --joint)."
        )
    if largest.amplitude > math.pi and not board.slides:
        raise SysidError(
            f"{where} {largest.amplitude:.4g} rad from rest, more than half a turn; the joint of board "
            f"'{board.name}' allows ±{limit:.3g} rad. If the log is in degrees, say --unit deg; if in counts, the size of one in rad."
        )
    if largest.amplitude > 1.5 * limit:
        return [
            f"{where} {_si(largest.amplitude, board)} from rest, but the joint of board '{board.name}' allows "
            f"±{_si(limit, board)}: is it this board, and is the unit right (--unit)?"
        ]
    if max(release.amplitude for release in releases) < 0.02 * limit:
        return [f"{where} {show(largest.amplitude, 2)} from rest only: is the unit right (--unit)?"]
    if board.slides and largest.origin == "angle":
        return [
            f"{largest.log}: read as an angle, but the joint slides: give the unit of its position (--unit m)"
        ]
    return []


def _si(value: float, board: Board) -> str:
    return f"{value:.3g} {'m' if board.slides else 'rad'}"


def record_warnings(
    numbers: DecayNumbers, board: Board, *, log: str, linear: bool, one_sided: bool = False
) -> list[str]:
    """Compare stiffness and damping of a decay with the board's record.

    Args:
        numbers: From the decay, with the record's inertia.
        one_sided: All releases were to one side. Dry friction stops them alike, which looks like another rest angle.

    Returns:
        At most one warning, with all numbers that differ.
    """
    outside: list[str] = []
    for name, symbol in (("stiffness", "k"), ("damping", "d")):
        found, stated = getattr(numbers, name), board.tilt[name]
        apart, spread = found.value - stated.value, math.hypot(found.std, stated.std)
        if stated.value > 0 and abs(apart) > max(SURE * spread, WORTH_SAYING * stated.value):
            outside.append(f"{symbol} = {found} where the record has {stated} ({apart / stated.value:+.0%})")
    if not outside:
        return []
    ratio = numbers.omega_n.value / _stated_frequency(board)
    zeta = board.tilt["damping"].value / (2 * _stated_frequency(board) * board.inertia.value)
    same_shape = abs(numbers.damping_ratio.value - zeta) < max(0.05 * zeta, SURE * numbers.damping_ratio.std)
    cause = (
        f"the damping ratio agrees, and only the period is {1 / ratio:.3g} times the record's: is the unit of time right, "
        "or the sampling rate (--rate)?"
        if linear and same_shape and abs(math.log(ratio)) > 0.2
        else "releases to one side cannot show dry friction, which stops all of them alike: release to the other side as well. If k "
        "and d stay, is it this board, with this roll inertia, and is the time right?"
        if linear and one_sided
        else "is it this board, with this roll inertia, and is the time right?"
        if linear
        else "the linear decay is the wrong model: run `husky-sysid diagnose` before you change the record"
    )
    return [f"{log} does not agree with the record of board '{board.name}': {'; '.join(outside)}; {cause}"]


def period_warnings(omega_n: float, board: Board, *, log: str) -> list[str]:
    """Warn of a natural period that is impossible for any joint: longer than 100 s, or shorter than 1 ms.

    Args:
        omega_n: Natural frequency [rad/s].
        board: The record.
    """
    period, stated = 2 * math.pi / omega_n, 2 * math.pi / _stated_frequency(board)
    if SHORTEST < period < LONGEST:
        return []
    return [
        f"{log}: the natural period is {period:.4g} s, implausible for a joint ({period / stated:.3g} times that of the record of board "
        f"'{board.name}'). Probably the unit of the time is not that of its column's name, or the sampling rate is wrong. Put the unit "
        "into the name (time_ms), or give --rate."
    ]


def refuse_period(omega_n: float, board: Board, *, log: str) -> None:
    """Reject a natural period that is impossible for any joint.

    Raises:
        SysidError: It is longer than 100 s or shorter than 1 ms.
    """
    for warning in period_warnings(omega_n, board, log=log):
        raise SysidError(f"{warning} The record is unchanged. If the period is real, give --any-period.")


def _stated_frequency(board: Board) -> float:
    return math.sqrt(max(board.tilt["stiffness"].value, 1e-9) / board.inertia.value)
