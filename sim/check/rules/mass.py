"""The board of the scene is heavier or lighter than the record's."""

from collections.abc import Iterator

from sim.check.rules._base import Case, Rule

MAX_MASS_DIFFERENCE = 0.05
"""Share by which masses may differ [1]: more than bolts, bearings and grip tape, less than another pair of trucks. A choice; the
rule speaks only after a failure."""


def _says(case: Case) -> Iterator[str]:
    parts, mass = case.board.mass, case.joint.mass
    expected = parts["deck"].value + 2 * parts["truck"].value + 4 * parts["wheel"].value
    if abs(mass / expected - 1) > MAX_MASS_DIFFERENCE:
        yield f"the board of the scene weighs {mass:.3g} kg, the record says {expected:.3g} kg"


RULE = Rule(order=6, asked=("failed",), says=_says, of_board=True)
