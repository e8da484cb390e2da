"""The verdict where every model leaves more than noise: no likelihood holds, and only what predicts counts.

The simplest model within one standard error of the best prediction is taken, and named only if it takes most
of the error away.
"""

from collections.abc import Sequence

import numpy as np

from sysid.diagnosis.search import Model
from sysid.diagnosis.verdict import Case, Judgement, motion_rms, verdict_on
from sysid.diagnosis.wording import deciding_experiment, is_or_are, it_or_them, listed, shares_in_words
from sysid.fitting.result import strength

PRECISE = 10.0
"""Residual over noise floor from which the sensor sees more than any model of a joint holds."""
VISIBLE = 3.0
"""Residual over noise floor from which a small rest is a matter of taste, not of detection."""
EXPLAINED = 0.8
"""Share of the squared held-out error that effects must take away to be named without reaching the noise."""
CLOSE = 0.1
"""Held-out error over the RMS of the motion up to which effects are named without reaching the noise."""
NEAR = 3.0
"""Where no residual is white, one more effect must cut the squared held-out error by this factor."""
MATERIAL = 0.0075
"""Error of the model over the RMS of the motion below which nothing is missing that matters."""


def judge_prediction(case: Case) -> Judgement:
    """Something is left: the simplest of the best predictors, and only if it takes most of the error away."""
    few = [m for m in case.models if len(case.missing(m)) <= 2 and np.isfinite(m.heldout_rmse)]
    if not few:
        return _unexplained(case, case.base, 0.0)
    # Internal states that are fitted to the very release that is to be predicted make that easier.
    fair = [m for m in few if not (m.problem.free_states and m.problem.structure.internal_states)] or few
    best = min(fair, key=lambda m: m.heldout_rmse)
    near = [
        m for m in few
        if _within_one_error(m, best) or case.excess(m) <= NEAR * case.excess(best)
    ]  # fmt: skip
    fewest = min(len(m.effects) for m in near)
    winner = min((m for m in near if len(m.effects) == fewest), key=lambda m: (m.size, m.heldout_rmse))
    before, after = case.excess(case.base), case.excess(winner)
    explained = 1.0 - after / before if before > 0 else 0.0
    precise = winner.rmse > PRECISE * case.noise.std
    size = motion_rms(case.base)
    rest = case.base.rmse / size
    if rest < MATERIAL and case.base.rmse > VISIBLE * case.noise.std:
        text = (
            f"Nothing is missing that matters: the model follows the motion to {100 * rest:.2f} % of its RMS. "
            "What is left is not noise, but too small to say what it is."
        )
        verdict = verdict_on(case, case.base, "none-missing", (), 0.8, (), "", text)
        return verdict, case.base, {}
    named = case.missing(winner)
    if named and precise and explained >= EXPLAINED and winner.heldout_rmse < CLOSE * size:
        return _partly(case, winner, near, explained)
    return _unexplained(case, winner, explained)


def _partly(case: Case, winner: Model, near: Sequence[Model], explained: float) -> Judgement:
    named = case.missing(winner)
    alike = tuple(
        case.missing(m) for m in near
        if m is not winner and m is not case.base and len(m.effects) == len(winner.effects)
    )  # fmt: skip
    shares = strength(winner.problem, winner.minimum, named)
    text = (
        f"{listed(named)} {is_or_are(named)} missing: with {it_or_them(named)} the prediction of held-out motion has "
        f"{100 * explained:.0f} % less squared error. {shares_in_words(shares)} The sensor is so precise that a rest of "
        f"{winner.rmse / case.noise.std:.0f} times its noise remains; one known effect "
        "more does not cut the error of prediction to a third."
    )
    confidence = 0.9 * explained / (1 + len(alike))
    experiment = deciding_experiment(named, alike)
    return verdict_on(case, winner, "missing", named, confidence, alike, experiment, text), winner, shares


def _unexplained(case: Case, winner: Model, explained: float) -> Judgement:
    named = case.missing(winner)
    text = "Something is missing that no effect of the catalogue explains, alone, in pairs or in threes. "
    if named:
        text += (
            f"The nearest is {listed(named)}, which takes away {100 * max(explained, 0):.0f} % of the squared error but leaves "
            f"a motion that is not noise ({winner.rmse / case.noise.std:.2f} times the noise floor). "
        )
    text += contradiction(case)
    text += "The map of the missing torque (compare) shows at which angle and rate it acts."
    experiment = (
        "Release from 3°, 7° and 12° to both sides, three times each: what repeats is a law, what does not is "
        "the board changing or the sensor."
    )
    return verdict_on(case, winner, "unexplained", (), 0.9, (), experiment, text), winner, {}


def contradiction(case: Case) -> str:
    """Say so if every release fits the linear joint alone, each with its own stiffness."""
    from sysid.fitting.search import fit_each

    rows = fit_each(case.base.problem, case.base.minimum)
    if len(rows) < 2:
        return ""
    alone = sum(cost for _, cost in rows)
    if alone > 1.15 * case.base.problem.samples:
        return ""
    values = ", ".join(f"{k:.4g}" for k, _ in rows)
    return (
        f"Each release alone fits the model, with stiffnesses {values} N*m/rad: the releases contradict each "
        "other, as if the board had changed between them (or the stiffness depends on the amplitude). "
    )


def _within_one_error(model: Model, best: Model) -> bool:
    """Whether held-out errors differ by less than 1 % or one standard error, release by release."""
    assert model.heldout is not None
    assert best.heldout is not None
    if model.heldout_rmse <= 1.01 * best.heldout_rmse:
        return True
    blocks = 8 if len(model.heldout) == 1 else 1
    differences = [
        float(np.sum(a**2 - b**2))
        for one, other in zip(model.heldout, best.heldout, strict=True)
        for a, b in zip(np.array_split(one, blocks), np.array_split(other, blocks), strict=True)
    ]
    n = len(differences)
    mean = float(np.mean(differences))
    return mean <= float(np.std(differences, ddof=1)) / np.sqrt(n) if n > 1 else False
