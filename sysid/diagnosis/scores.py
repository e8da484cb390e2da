"""How likely models are against each other: the extended BIC."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.diagnosis.search import Model
from sysid.noise.whiteness import correlation_length


@dataclass(frozen=True, slots=True)
class Yardstick:
    """What a fall of χ² is worth, and what a parameter costs."""

    unit: float
    """χ² that counts as one: residuals that are correlated over c samples count as n/c independent ones."""
    price: float
    """Of one parameter."""

    def score(self, chi2: float, size: int) -> float:
        """Return the extended BIC (Chen and Chen, Biometrika 95, 2008)."""
        return chi2 / self.unit + self.price * size


def yardstick(finalists: Sequence[Model], catalogue: int) -> Yardstick:
    """Return the yardstick that the best of some models gives.

    Args:
        finalists: Fitted to single samples.
        catalogue: How many effects were to choose from.
    """
    best = min(finalists, key=lambda m: m.chi2)
    length = max(1.0, correlation_length(best.residuals))
    variance = max(best.chi2 / best.samples, 0.25)
    price = np.log(max(best.samples / length, 3.0)) + 2 * np.log(catalogue)
    return Yardstick(variance * length, float(price))


def extended_bic(
    finalists: Sequence[Model], screened: Sequence[Model], rule: Yardstick
) -> dict[tuple[str, ...], float]:
    """Return the extended BIC of models, less the best finalist.

    Screened models were fitted to averages; what that hides is the same for all, and known from those fitted
    both ways.
    """
    refined = {m.effects: m for m in finalists}
    both = [refined[m.effects].chi2 - m.chi2 for m in screened if m.effects in refined]
    hidden = float(np.median(both)) if both else 0.0
    scores = {m.effects: rule.score(m.chi2 + hidden, m.size) for m in screened}
    scores.update({m.effects: rule.score(m.chi2, m.size) for m in finalists})
    low = min(scores[m.effects] for m in finalists)
    return {key: value - low for key, value in scores.items()}
