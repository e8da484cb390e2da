"""A board with scaled parameters, to test a policy on other boards than its own."""

import math
from collections.abc import Mapping
from dataclasses import replace

from sysid.board import Board
from sysid.errors import SysidError
from sysid.quantity import Quantity

FACTORS = {"k": "stiffness", "d": "damping", "inertia": "roll inertia", "rake": "rake"}
"""Quantities that can be scaled, by the names of --board-scale."""
STEEPEST_RAKE = math.radians(80)
"""Largest rake [rad]: the trucks would turn 5.6 times as far as the deck tilts."""


def scaled_board(board: Board, factors: Mapping[str, float]) -> Board:
    """Return a board with some numbers multiplied, by the names of `FACTORS`; its check and its effects' parameters stay.

    Raises:
        SysidError: A name is unknown, a factor is negative or not finite, or the rake is too steep.
    """

    def times(quantity: Quantity, name: str) -> Quantity:
        factor = factors.get(name, 1.0)
        return replace(quantity, value=factor * quantity.value, std=factor * quantity.std)

    for name, factor in factors.items():
        if name not in FACTORS:
            raise SysidError(f"--board-scale {name}={factor:g}: unknown. Known: {', '.join(FACTORS)}.")
        if not (0 <= factor < math.inf) or (factor == 0 and name == "inertia"):
            raise SysidError(f"--board-scale {name}={factor:g}: must be a finite factor, not negative.")
    rake = times(board.geometry["rake"], "rake")
    if rake.value > STEEPEST_RAKE:
        raise SysidError(
            f"--board-scale rake={factors['rake']:g}: makes it {math.degrees(rake.value):.0f}°, "
            f"at most {math.degrees(STEEPEST_RAKE):.0f}°."
        )
    tilt = {name: times(board.tilt[full], name) for name, full in FACTORS.items() if full in board.tilt}
    scaled = board.with_tilt(**{FACTORS[name]: value for name, value in tilt.items()})
    return replace(scaled, inertia=times(board.inertia, "inertia"), geometry={**board.geometry, "rake": rake})
