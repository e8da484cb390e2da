"""Write the records of the two boards of the HUSKY paper beside this script.

The paper's roll inertia, period and two peaks are the data (appendix H); stiffness and damping follow
from them by the tool's own code. Dimensions are those of the model that was published with the paper.
The mass of the deck is what a uniform cuboid of these dimensions must weigh to have the stated inertia.

    python data/boards/make_boards.py
    husky-sysid check data/decays/pink.csv --board pink
    husky-sysid check data/decays/black.csv --board black
"""

import math
from pathlib import Path

from sysid.board import Board, save_board
from sysid.free_decay import decay_from_peaks
from sysid.quantity import Quantity

WIDTH, THICKNESS = 0.2, 0.02
GEOMETRY = {
    "length": Quantity(0.8, 0.005, "m"),
    "width": Quantity(WIDTH, 0.002, "m"),
    "thickness": Quantity(THICKNESS, 0.001, "m"),
    "wheelbase": Quantity(0.4, 0.005, "m"),
    "track": Quantity(0.14, 0.002, "m"),
    "wheel_radius": Quantity(0.03, 0.0005, "m"),
    "truck_height": Quantity(0.07, 0.002, "m"),
    "rake": Quantity(math.radians(60), 0.02, "rad"),
}
TILT_RANGE = Quantity(0.2, 0.0, "rad")


def main() -> None:
    """Write both records."""
    folder = Path(__file__).parent
    for board in (black(), pink()):
        save_board(board, folder / f"{board.name}.toml")


def black() -> Board:
    """Return the stiff board."""
    return _board(
        "black",
        "stiff board of the HUSKY paper (its first)",
        inertia=_printed(7.15e-3, 1e-5, "kg*m^2"),
        period=_printed(0.107, 1e-3, "s"),
        first_peak=_printed(0.614, 1e-3, "rad"),
        second_peak=_printed(0.0108, 1e-4, "rad"),
        stiffness=_printed(34.835, 1e-3, "N*m/rad"),
        damping=_printed(0.540, 1e-3, "N*m*s/rad"),
    )


def pink() -> Board:
    """Return the compliant board."""
    return _board(
        "pink",
        "compliant board of the HUSKY paper (its second)",
        inertia=_printed(8.70e-3, 1e-5, "kg*m^2"),
        period=_printed(0.185, 1e-3, "s"),
        first_peak=_printed(0.583, 1e-3, "rad"),
        second_peak=_printed(0.0081, 1e-4, "rad"),
        stiffness=_printed(14.677, 1e-3, "N*m/rad"),
        damping=_printed(0.402, 1e-3, "N*m*s/rad"),
    )


def _printed(value: float, last_digit: float, unit: str) -> Quantity:
    """A printed number is uncertain by its rounding at least: uniform over one unit of its last digit."""
    return Quantity(value, float(f"{last_digit / math.sqrt(12):.3g}"), unit)


def _board(
    name: str,
    description: str,
    *,
    inertia: Quantity,
    period: Quantity,
    first_peak: Quantity,
    second_peak: Quantity,
    stiffness: Quantity,
    damping: Quantity,
) -> Board:
    numbers = decay_from_peaks(period, first_peak, second_peak, inertia)
    deck = 12 * inertia.value / (WIDTH**2 + THICKNESS**2)
    return Board(
        name=name,
        description=description,
        source="HUSKY, RSS 2026, appendix H",
        geometry=GEOMETRY,
        mass={
            "deck": Quantity(round(deck, 3), 0.05, "kg"),
            "truck": Quantity(0.5, 0.02, "kg"),
            "wheel": Quantity(0.2, 0.01, "kg"),
        },
        inertia=inertia.with_method(
            "as the paper states it (uniform cuboid); the deviation is its last digit's rounding only"
        ),
        decay={"period": period, "first_peak": first_peak, "second_peak": second_peak},
        published={"stiffness": stiffness, "damping": damping},
        tilt={
            "stiffness": _rounded(numbers.stiffness),
            "damping": _rounded(numbers.damping),
            "rest_angle": Quantity(0.0, 0.0, "rad"),
            "range": TILT_RANGE,
        },
    )


def _rounded(quantity: Quantity) -> Quantity:
    """Six digits: two more than the paper's, three more than its uncertainty."""
    return Quantity(float(f"{quantity.value:.6g}"), float(f"{quantity.std:.3g}"), quantity.unit)


if __name__ == "__main__":
    main()
