"""The trucks meet their limits before the deck meets its own."""

from collections.abc import Iterator

from sim.check.rules._base import Case, Rule

MIN_RANGE_SHARE = 0.95
"""Share of the deck's range that the trucks must allow (a choice): a stop gives way by a few hundredths of it. With 0.9 a linkage
that is too short by a tenth goes unnamed; no verdict hangs on it, for the rule speaks where the gate has failed."""


def _says(case: Case) -> Iterator[str]:
    reach, own = case.joint.reach, case.tilt_range
    if reach < MIN_RANGE_SHARE * own:
        yield f"the trucks' limits stop the deck at ±{reach:.3g} rad although its own range is ±{own:.3g} rad"


RULE = Rule(order=7, asked=("failed",), says=_says, of_board=True)
