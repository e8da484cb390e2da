"""How likely models are against each other: the extended BIC."""

from collections.abc import Sequence

import numpy as np

from sysid.model_search import Model
from sysid.noise import correlation_length


def extended_bic(
    finalists: Sequence[Model], screened: Sequence[Model], catalogue: int
) -> dict[tuple[str, ...], float]:
    """Return the extended BIC of models (Chen and Chen, Biometrika 95, 2008), less the best finalist.

    Residuals that are correlated over c samples count as n/c independent ones. Screened models were
    fitted to averages; what that hides is the same for all, and known from those fitted both ways.
    """
    best = min(finalists, key=lambda m: m.chi2)
    length = max(1.0, correlation_length(best.residuals))
    variance = max(best.chi2 / best.samples, 0.25)
    price = np.log(max(best.samples / length, 3.0)) + 2 * np.log(catalogue)
    refined = {m.effects: m for m in finalists}
    both = [refined[m.effects].chi2 - m.chi2 for m in screened if m.effects in refined]
    hidden = float(np.median(both)) if both else 0.0

    def score(model: Model, chi2: float) -> float:
        return chi2 / (variance * length) + price * model.size

    scores = {m.effects: score(m, m.chi2 + hidden) for m in screened}
    scores.update({m.effects: score(m, m.chi2) for m in finalists})
    low = min(scores[m.effects] for m in finalists)
    return {key: value - low for key, value in scores.items()}
