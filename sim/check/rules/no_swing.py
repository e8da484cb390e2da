"""The scene's deck is overdamped where the board's swings."""

from collections.abc import Iterator

from sim.check.rules._base import Case, Rule


def _says(case: Case) -> Iterator[str]:
    ratio, wanted = case.joint.whole.damping_ratio, case.joint.wanted.damping_ratio
    if ratio >= 1 > wanted:
        yield (
            f"released from rest the deck does not swing at all (damping ratio {ratio:.2f} where {wanted:.2f} is wanted)"
        )


RULE = Rule(order=4, asked=("failed",), says=_says, of_board=True)
