"""The scene's decays are further from the measured ones than is accepted."""

from collections.abc import Iterator

from sim.check.rules._base import Case, Rule


def _says(case: Case) -> Iterator[str]:
    decays = case.decays
    if decays.nrmse > decays.tolerance:
        yield (
            f"the scene does not decay like {case.kind} '{case.board.name}': NRMSE {100 * decays.nrmse:.1f} %, tolerance "
            f"{100 * decays.tolerance:g} %"
        )


RULE = Rule(order=1, asked=("before",), says=_says)
