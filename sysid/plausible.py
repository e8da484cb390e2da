"""Angles and numbers that a board's joint cannot have: a wrong unit, another board, a wrong model."""

import math
from collections.abc import Sequence

from sysid.board import Board
from sysid.decay_numbers import DecayNumbers
from sysid.errors import HuskyError
from sysid.roll import Release

APART = 3.0
"""A number lies outside the record from this many standard deviations of the difference on."""
WORTH_SAYING = 0.03
"""And by this share of it: boards change by as much from day to day."""


def amplitude_warnings(releases: Sequence[Release], board: Board) -> list[str]:
    """Hold the amplitudes of some releases against the range of the board's joint.

    Returns:
        What looks odd, in words.

    Raises:
        HuskyError: The deck was let go from more than half a turn.
    """
    largest = max(releases, key=lambda release: release.amplitude)
    limit = board.tilt["range"].value
    where = f"{largest.log}: the release at {largest.start:.4g} s starts"
    if largest.amplitude > math.pi:
        raise HuskyError(
            f"{where} {largest.amplitude:.4g} rad from rest, more than half a turn; the joint of board "
            f"'{board.name}' allows ±{limit:.3g} rad. If the log is in degrees, say --unit deg."
        )
    if largest.amplitude > 1.5 * limit:
        return [
            f"{where} {largest.amplitude:.3g} rad from rest, but the joint of board '{board.name}' allows "
            f"±{limit:.3g} rad: is it this board, and is the unit right (--unit)?"
        ]
    if max(release.amplitude for release in releases) < 0.02 * limit:
        return [f"{where} {math.degrees(largest.amplitude):.2g}° from rest only: is the unit right (--unit)?"]
    return []


def record_warnings(numbers: DecayNumbers, board: Board, *, log: str, linear: bool) -> list[str]:
    """Hold stiffness and damping of a decay against what the board's record states.

    Args:
        numbers: From the decay, with the record's inertia.
        board: The record.
        log: Where the decay is from, for people.
        linear: Whether the decay is a linear one.

    Returns:
        One warning that names all that lies outside, or none.
    """
    outside: list[str] = []
    for name, symbol in (("stiffness", "k"), ("damping", "d")):
        found, stated = getattr(numbers, name), board.tilt[name]
        apart, spread = found.value - stated.value, math.hypot(found.std, stated.std)
        if stated.value > 0 and abs(apart) > max(APART * spread, WORTH_SAYING * stated.value):
            outside.append(f"{symbol} = {found} where the record has {stated} ({apart / stated.value:+.0%})")
    if not outside:
        return []
    cause = (
        "is it this board, with this roll inertia, and is the time right?"
        if linear
        else "the linear decay is the wrong model, so keep the record until `husky-sysid diagnose` has named what "
        "is missing"
    )
    return [f"{log} does not agree with the record of board '{board.name}': {'; '.join(outside)}; {cause}"]
