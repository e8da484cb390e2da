"""The scene's deck is overdamped where the board's swings."""

from collections.abc import Iterator

from sim.check.rules._base import Case, Rule


def _says(case: Case) -> Iterator[str]:
    ratio, wanted = case.joint.whole.damping_ratio, case.joint.wanted.damping_ratio
    if ratio >= 1 > wanted:
        yield (f"the deck does not swing: its damping ratio is {ratio:.2f}, expected {wanted:.2f}")


RULE = Rule(order=4, asked=("failed",), says=_says, of_board=True)
