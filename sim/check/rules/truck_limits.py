"""The trucks meet their limits before the deck meets its own."""

from collections.abc import Iterator

from sim.check.rules._base import Case, Rule

MIN_RANGE_SHARE = 0.95
"""Share of the deck's range that the trucks must allow [1]: a stop gives way by a few hundredths. A choice; the rule speaks only
after a failure."""


def _says(case: Case) -> Iterator[str]:
    reach, own = case.joint.reach, case.tilt_range
    if reach < MIN_RANGE_SHARE * own:
        yield f"the trucks' limits stop the deck at ±{reach:.3g} rad although its own range is ±{own:.3g} rad"


RULE = Rule(order=7, asked=("failed",), says=_says, of_board=True)
