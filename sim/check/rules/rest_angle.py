"""The scene moves as measured, about another rest."""

from collections.abc import Iterator

from sim.check.rules._base import Case, Rule
from sysid.text import display


def _says(case: Case) -> Iterator[str]:
    if case.decays.only_rest_is_off:
        show = display(is_rate=False, slides=case.board.slides)
        yield (
            f"the measured rest is {show(case.decays.rest_error, 2)} from the scene's (fit the record to these logs, or "
            "level the sensor)"
        )


RULE = Rule(order=2, asked=("failed",), says=_says, whole_answer=True)
