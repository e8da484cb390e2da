"""The scene moves as it should, about another angle."""

import math
from collections.abc import Iterator

from sim.check.rules._base import Case, Rule


def _says(case: Case) -> Iterator[str]:
    if case.decays.only_rest_is_off:
        yield (
            f"the deck rests {math.degrees(case.decays.rest_error):.2g}° from where the record lets the scene rest (fit "
            "the record to these logs, or level the sensor)"
        )


RULE = Rule(order=2, asked=("failed",), says=_says, whole_answer=True)
