"""The verdict where a model leaves nothing but the sensor's noise: then likelihood may judge.

An effect is named if it pays for its parameters and for having been picked from a catalogue.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnosis.against_record import record_deviation
from sysid.diagnosis.by_prediction import contradiction
from sysid.diagnosis.outside_catalogue import Unnamed, unnamed_torques
from sysid.diagnosis.search import Model
from sysid.diagnosis.verdict import TIE, Case, Judgement, verdict_on
from sysid.diagnosis.wording import deciding_experiment, is_or_are, it_or_them, listed, shares_in_words
from sysid.fitting.result import strength
from sysid.fitting.search import fit_each

BEYOND_DOUBT = 6.0
"""Score that the joint without it must be worse by for an effect to be named (odds of e³)."""
MANY = 3
"""Effects that together bend to almost any smooth law: they fit, and are not named for that."""
POOR = 1.3
"""Held-out error over noise floor from which a model that fits is not trusted as such."""


def likeliest(case: Case) -> Model | None:
    """Return the simplest of the likeliest models that leave nothing but noise, if there is one.

    Nothing is named beyond the joint as it is, and no effect beyond another, on odds that chance makes.
    """
    for model in case.models:
        score = case.scores[model.effects]
        if score >= 2 * TIE:
            return None
        if not case.is_noise(model):
            continue
        smaller = [
            m for m in case.models
            if set(m.effects) < set(model.effects) and case.scores[m.effects] < score + BEYOND_DOUBT and case.is_noise(m)
        ]  # fmt: skip
        winner = min(smaller, key=lambda m: m.size, default=model)
        return winner if len(case.missing(winner)) < MANY else None
    return None


def judge_noise(case: Case, winner: Model) -> Judgement:
    """The noise is all that is left: likelihood decides."""
    rivals = [
        m for m in case.models
        if m is not winner and case.scores[m.effects] < TIE and not set(m.effects) > set(winner.effects) and case.is_noise(m)
    ]  # fmt: skip
    weights = [np.exp(-0.5 * case.scores[m.effects]) for m in case.models]
    confidence = float(weights[case.models.index(winner)] / sum(weights))
    named = case.missing(winner)
    if named:
        gains = [(_gain(case, winner, other), other) for other in unnamed_torques(case.searcher, winner)]
        gain, other = max(gains, key=lambda pair: pair[0])
        if gain > TIE:
            return _mimicked(case, winner, other)
        if _change_gain(case, winner) > TIE:
            return _changed(case, winner)
    loss = winner.heldout_rmse / max(case.noise.std, 1e-300)
    if named and loss > POOR:
        # What fits but does not predict is not known, however likely it is among these models.
        confidence *= float(POOR / loss)
        alike_white = [m for m in case.models if m not in (winner, case.base) and case.is_noise(m)]
        rivals += [
            m for m in alike_white
            if m not in rivals and m.heldout_rmse < winner.heldout_rmse / POOR and len(case.missing(m)) <= 2
            and case.scores[m.effects] < 4 * TIE
        ]  # fmt: skip
    alike = [case.missing(m) for m in rivals if m is not case.base]
    doubtful = any(m is case.base for m in rivals)
    verdict, best, shares = _with_record(case, winner, named, alike, confidence, doubtful=doubtful)
    if named and loss > POOR:
        note = (
            f" Not sure: held-out releases are predicted with {loss:.1f} times the noise only, because the others do "
            "not fix the parameters. Record more releases, to both sides."
        )
        verdict = replace(verdict, explanation=verdict.explanation + note)
    return verdict, best, shares


def _gain(case: Case, winner: Model, other: Unnamed) -> float:
    """Return by how much a law outside the catalogue is the better description, as a difference of scores.

    One effect of the catalogue has a cause that people have met; its rival pays a parameter for having none.
    """
    gain = case.rule.score(winner.chi2, winner.size) - case.rule.score(other.chi2, other.size)
    return gain - (case.rule.price if len(other.replaced) == 1 else 0.0)


def _change_gain(case: Case, winner: Model) -> float:
    """Return by how much a plain joint that changed between the releases is the better description.

    Internal states that are fitted to each release can take up such a change.
    """
    rows = fit_each(case.base.problem, case.base.minimum)
    averaged = case.base.samples - case.base.problem.samples
    changed = case.rule.score(sum(cost for _, cost in rows) + averaged, case.base.size * len(rows))
    return case.rule.score(winner.chi2, winner.size) - changed if len(rows) > 1 else -np.inf


def _changed(case: Case, winner: Model) -> Judgement:
    """What was to be named fits, by states of its own in each release; a board that changed says it with less."""
    text = (
        f"{contradiction(case)}With internal states fitted to each release, {listed(case.missing(winner))} leaves nothing but "
        "noise too, at the price of more numbers."
    )
    experiment = "Release from the same angle three times, in one go, then check screws, bushings and what the board stands on."
    return verdict_on(case, winner, "unexplained", (), 0.9, (), experiment, text), winner, {}


def _mimicked(case: Case, winner: Model, other: Unnamed) -> Judgement:
    """What was to be named fits, but something that is not in the catalogue fits better."""
    beside = f", beside {listed(case.missing_of(other.kept))}," if case.missing_of(other.kept) else ""
    fewer = winner.size - other.size
    how = f"with {fewer} number{'s' if fewer > 1 else ''} fewer" if fewer > 0 else "better"
    text = (
        f"Something is missing that no effect of the catalogue explains: {other.words}{beside} does it {how} than "
        f"{listed(other.replaced)}, which would leave nothing but noise too, by mimicking it. The map of the missing "
        "torque (compare) shows at which angle and rate it acts."
    )
    return verdict_on(case, winner, "unexplained", (), 0.9, (), other.experiment, text), winner, {}


def _with_record(
    case: Case,
    winner: Model,
    named: tuple[str, ...],
    alike: Sequence[tuple[str, ...]],
    confidence: float,
    *,
    doubtful: bool,
) -> Judgement:
    """Add what shows only against the record: a shift, another inertia, gravity, a clock."""
    shares = strength(winner.problem, winner.minimum, named)
    deviation = record_deviation(winner, case.board, look_at_linear=not named)
    effects = (*named, *deviation.effects)
    sets = [(*others, *deviation.effects) for others in alike]
    sets += [(*named, *other) for other in deviation.alike]
    ratio = winner.rmse / case.noise.std
    left = "coloured noise" if case.kinds.get(winner.effects) == "coloured" else "white"
    if not effects:
        text = (
            f"Nothing is missing: the residual is {left} and {ratio:.2f} times the noise floor. {deviation.text}"
        ).strip()
        return verdict_on(case, winner, "none-missing", (), confidence, (), "", text), winner, {}
    text = (
        f"{listed(effects)} {is_or_are(effects)} missing: with {it_or_them(effects)} the residual is {left} and {ratio:.2f} times "
        f"the noise floor (before: {case.base.rmse / case.noise.std:.2f}). {shares_in_words(shares)} {deviation.text}"
    ).strip()
    if doubtful:
        text += " The evidence is thin: the model without it is nearly as likely."
    if sets:
        text += f" These data cannot tell it from {'; or '.join(listed(s) for s in sets)}."
    experiment = deviation.experiment if deviation.effects and not named else deciding_experiment(named, sets)
    verdict = verdict_on(case, winner, "missing", effects, confidence, tuple(sets), experiment, text)
    return verdict, winner, shares
