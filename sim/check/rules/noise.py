"""The sensor's noise could hide an error beyond the tolerance."""

from collections.abc import Iterator

from sim.check.rules._base import Case, Rule


def _says(case: Case) -> Iterator[str]:
    if case.decays.hidden > case.decays.tolerance:
        yield "the logs are too noisy for this tolerance: record longer, more often, or with a better sensor"


RULE = Rule(order=8, asked=("passed",), says=_says)
