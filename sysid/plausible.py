"""Angles that a joint cannot have: nearly always a wrong unit."""

import math
from collections.abc import Sequence

from sysid.board import Board
from sysid.errors import HuskyError
from sysid.roll import Release


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
