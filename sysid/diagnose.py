"""What is the model missing? A verdict that the data can defend, or none.

Two cases, told apart by the residual of the best model. If it is white, the noise is all that is left
and likelihood may judge: an effect is named if it pays for its parameters and for having been picked
from a catalogue (extended BIC). If not, no likelihood holds; then only what predicts other releases
counts, and the simplest model within one standard error of the best prediction is taken.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from sysid.board import Board
from sysid.crew import Crew
from sysid.effects import effect
from sysid.errors import HuskyError
from sysid.fit_mjcf import strength
from sysid.fit_problem import Bias, make_records
from sysid.fit_search import scales_of
from sysid.fit_uncertainty import parameter_quantities
from sysid.leftover import BAND, WHITE, Kind, kind_of, whiteness
from sysid.model_search import Model, Progress, Searcher
from sysid.noise import NoiseFloor, correlation_length, noise_floor
from sysid.plausible import amplitude_warnings
from sysid.quantity import Quantity
from sysid.record_check import record_deviation
from sysid.roll import Release

Status = Literal["none-missing", "missing", "unexplained"]

TIE = 8.0
"""Difference of score below which two models are not told apart (odds of e⁴ at most)."""
BEYOND_DOUBT = 6.0
"""Score that the joint without it must be worse by for an effect to be named (odds of e³)."""
MANY = 3
"""Effects that together bend to almost any smooth law: they fit, and are not named for that."""
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
FAR = 30.0
"""Difference of score while screening from which a model is out of the running."""
POOR = 1.3
"""Held-out error over noise floor from which a model that fits is not trusted as such."""
MATERIAL = 0.0075
"""Error of the model over the RMS of the motion below which nothing is missing that matters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One model that was tried."""

    effects: tuple[str, ...]
    """What it has beyond the board's record."""
    rmse: float
    heldout_rmse: float | None
    """None where the model was out of the running before it came to that."""
    score: float
    """Extended BIC less that of the best: 0 is best, 8 is e⁴ to 1 against."""
    parameters: Mapping[str, Quantity]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What is missing, and how sure that is."""

    status: Status
    effects: tuple[str, ...]
    confidence: float
    indistinguishable_from: tuple[tuple[str, ...], ...]
    error_before: float
    error_after: float
    next_experiment: str
    explanation: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """All that was found."""

    noise: NoiseFloor
    baseline: Candidate
    candidates: tuple[Candidate, ...]
    """Best first."""
    verdict: Verdict
    shares: Mapping[str, float]
    """Peak torque of each missing effect over the peak torque of the joint."""
    warnings: tuple[str, ...]
    best: Model = field(repr=False)
    base: Model = field(repr=False)
    swing_frequency: float | None = None
    """Where a rate was fitted, and errors are rates: the joint's natural frequency [rad/s]."""


@dataclass(frozen=True, slots=True)
class _Case:
    """Everything that the judgement needs."""

    board: Board
    base: Model
    models: Sequence[Model]
    """Polished and predicted, best score first, base included."""
    scores: Mapping[tuple[str, ...], float]
    noise: NoiseFloor
    period: float
    kinds: dict[tuple[str, ...], Kind] = field(default_factory=dict[tuple[str, ...], Kind])
    """What each model leaves, as far as it was asked."""

    def missing(self, model: Model) -> tuple[str, ...]:
        return tuple(name for name in model.effects if name not in self.base.effects)

    def is_noise(self, model: Model) -> bool:
        """Whether a model leaves nothing but noise."""
        if model.effects not in self.kinds:
            self.kinds[model.effects] = kind_of(model, self.period)
        return self.kinds[model.effects] != "motion"

    def excess(self, model: Model) -> float:
        """Held-out mean square error beyond the noise."""
        return max(model.heldout_rmse**2 - self.noise.std**2, 0.0)


def diagnose(
    releases: Sequence[Release],
    board: Board,
    *,
    bias: Bias = "shared",
    use_rate: bool = False,
    workers: int = 1,
    progress: Progress | None = None,
) -> Diagnosis:
    """Fit the catalogue to releases and judge what the board's record is missing.

    Args:
        releases: Free decays of one board; with one only, its second half is predicted from its first.
        board: The record; its effects are in every model.
        bias: One sensor zero for all releases, or one each.
        use_rate: Fit the measured rate instead of the roll.
        workers: Processes; with more than one, a script must guard its main part.
        progress: Called as the search goes on.

    Raises:
        HuskyError: The releases are too short, or their unit is wrong.
    """
    noise = noise_floor(releases, rate=use_rate)
    records = make_records(releases, noise.std, rate=use_rate)
    scales = scales_of(records, board)
    period = 2 * np.pi / scales.frequency
    warnings = check_releases(releases, board, period)
    with Crew(workers) as crew:
        searcher = Searcher(
            records=records, scales=scales, bias=bias, base=tuple(sorted(p.name for p in board.effects)),
            fixed={"rest_angle": board.rest_angle} if bias == "own" or use_rate else {},
            crew=crew, progress=progress,
        )  # fmt: skip
        models, final = _search(searcher, period)
    base = next(m for m in final if m.effects == searcher.base)
    scores = _scores(final, models, len(searcher.names()))
    final.sort(key=lambda m: scores[m.effects])
    noise = _noise_of(final[0], noise, period)
    case = _Case(board, base, final, scores, noise, period)
    verdict, best, shares = _judge(case)
    warnings += _fast_starts(best)
    if progress is not None:
        progress("done", 1.0)
    done = {m.effects for m in final}
    others = sorted((m for m in models if m.effects not in done), key=lambda m: scores[m.effects])
    return Diagnosis(
        noise=noise,
        baseline=_candidate(case, base),
        candidates=tuple(_candidate(case, m) for m in (*final, *others)),
        verdict=verdict,
        shares=shares,
        warnings=tuple(warnings),
        best=best,
        base=base,
        swing_frequency=scales.frequency if use_rate else None,
    )


def _search(searcher: Searcher, period: float) -> tuple[list[Model], list[Model]]:
    """Return all models that were fitted, and those of them that may win, refined and predicted."""
    singles = searcher.singles()
    ranked = sorted(singles[1:], key=lambda m: m.chi2)
    refined = searcher.polished(ranked[0])  # a coarse grid blurs stops and sliders
    chances = [whiteness(m, period) for m in (singles[0], refined, *ranked[:3])]
    settled = max(chances) > 0.05
    # The whiter the best model, the less another effect can add to it.
    partners = 1 if chances[0] > 0.2 else 2 if max(chances) > 0.2 else 3
    pairs = searcher.pairs(singles, ranked[:partners] if settled else None)
    models = [*singles, *pairs]
    if not settled and not any(
        whiteness(m, period) > WHITE for m in sorted(models, key=lambda m: m.chi2)[:4]
    ):
        best_pairs = sorted(pairs, key=lambda m: m.chi2)[:1]
        models += searcher.neighbours(best_pairs, singles)
    large = [m for m in models if len(m.effects) > len(searcher.base) + 1]
    models = searcher.reduced(sorted(large, key=lambda m: m.chi2)[:4], models)
    return models, _finalists(searcher, models, singles[0])


def check_releases(releases: Sequence[Release], board: Board, period: float) -> list[str]:
    """Refuse what no verdict can be made from, and say what looks odd.

    Raises:
        HuskyError: Angles that cannot be radians of a board, or releases shorter than a swing.
    """
    warnings = amplitude_warnings(releases, board)
    longest = max(float(r.time[-1] - r.time[0]) for r in releases)
    samples = max(len(r.time) for r in releases)
    if longest < 0.6 * period or samples < 24:
        raise HuskyError(
            f"the longest release has {samples} samples over {longest:.3g} s, and one swing takes {period:.3g} s: "
            "too short for a verdict. Record until the deck rests, and three releases or more."
        )
    if len(releases) == 1:
        warnings.append(
            "one release only: the second half of its motion was predicted from the first. Three releases "
            "from different angles, to both sides, make a much stronger test"
        )
    return warnings


def _noise_of(model: Model, floor: NoiseFloor, period: float) -> NoiseFloor:
    """Take the noise from a white residual, above the band of the joint: more of the samples count there.

    Only where differences agree; a sensor that smooths or has steps keeps its own estimate.
    """
    if not floor.how.startswith("from high-order differences"):
        return floor
    if kind_of(model, period) == "coloured":
        length = (
            1e3
            * correlation_length(model.residuals)
            * float(np.median(np.diff(model.problem.records[0].time)))
        )
        how = (
            f"from what the best model leaves: coloured noise, correlated over {length:.2g} ms, as large when the "
            "motion has faded as before"
        )
        return NoiseFloor(model.rmse, how)
    if whiteness(model, period) <= WHITE:
        return floor
    power, bins = 0.0, 0
    for residual, record in zip(model.residuals, model.problem.records, strict=True):
        step = float(np.median(np.diff(record.time)))
        above = np.fft.rfftfreq(len(residual), step) > BAND / period
        power += float(np.sum((np.abs(np.fft.rfft(residual)) ** 2 / len(residual))[above]))
        bins += int(above.sum())
    std = float(np.sqrt(power / max(bins, 1)))
    if bins < 20 or abs(std / floor.std - 1) > 4.0 / np.sqrt(model.samples):
        return floor
    return NoiseFloor(std, "from what the best model leaves above the band of the joint; differences agree")


def _fast_starts(model: Model) -> list[str]:
    """Say so if releases from a hold start faster than any release from rest could."""
    if model.problem.start_penalty(model.minimum.point) < 16.0:
        return []
    return [
        "the deck leaves the hand faster than the model allows: it was pushed, or something acts in the first "
        "milliseconds only, such as an end stop that the deck was held against. Release from smaller angles too"
    ]


def _finalists(searcher: Searcher, models: Sequence[Model], base: Model) -> list[Model]:
    """Refine and predict the models that may win: the best of every size, and the linear joint."""
    by_cost = sorted(models, key=lambda m: m.chi2)
    picked: dict[tuple[str, ...], Model] = {base.effects: base}
    for count, most in ((1, 4), (2, 6), (3, 2)):
        extra = [m for m in by_cost if len(m.effects) - len(base.effects) == count]
        picked.update({m.effects: m for m in extra[:most]})
    scores = _scores(models, models, len(searcher.names()))
    ranked = sorted(models, key=lambda m: scores[m.effects])
    picked.update({m.effects: m for m in ranked[:5]})
    if whiteness(by_cost[0], 2 * np.pi / searcher.scales.frequency) > WHITE:
        # The best is at the noise: what is this much less likely need not be refined to be told from it.
        kept = {base.effects, *(m.effects for m in ranked[:2])}
        picked = {k: m for k, m in picked.items() if k in kept or scores[k] < scores[ranked[0].effects] + FAR}
    jobs = [(model,) for model in picked.values()]
    return searcher.each("predicting what was held out", Searcher.finalist, jobs, 0.85, 0.99)


def _scores(
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


def _judge(case: _Case) -> tuple[Verdict, Model, dict[str, float]]:
    winner = _winner(case)
    return _judge_prediction(case) if winner is None else _judge_noise(case, winner)


def _winner(case: _Case) -> Model | None:
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


def _judge_noise(case: _Case, winner: Model) -> tuple[Verdict, Model, dict[str, float]]:
    """The noise is all that is left: likelihood decides."""
    rivals = [
        m for m in case.models
        if m is not winner and case.scores[m.effects] < TIE and not set(m.effects) > set(winner.effects) and case.is_noise(m)
    ]  # fmt: skip
    weights = [np.exp(-0.5 * case.scores[m.effects]) for m in case.models]
    confidence = float(weights[case.models.index(winner)] / sum(weights))
    named = case.missing(winner)
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


def _judge_prediction(case: _Case) -> tuple[Verdict, Model, dict[str, float]]:
    """Something is left: the simplest of the best predictors, and only if it takes most of the error away."""
    few = [m for m in case.models if len(case.missing(m)) <= 2 and np.isfinite(m.heldout_rmse)]
    if not few:
        return _unexplained(case, case.base, 0.0)
    best = min(few, key=lambda m: m.heldout_rmse)
    near = [
        m for m in few
        if _within_one_error(m, best) or case.excess(m) <= NEAR * case.excess(best)
    ]  # fmt: skip
    fewest = min(len(m.effects) for m in near)
    winner = min((m for m in near if len(m.effects) == fewest), key=lambda m: (m.size, m.heldout_rmse))
    before, after = case.excess(case.base), case.excess(winner)
    explained = 1.0 - after / before if before > 0 else 0.0
    precise = winner.rmse > PRECISE * case.noise.std
    size = _motion_rms(case.base)
    rest = case.base.rmse / size
    if rest < MATERIAL and case.base.rmse > VISIBLE * case.noise.std:
        text = (
            f"Nothing is missing that matters: the model follows the motion to {rest:.2%} of its RMS. "
            "What is left is not noise, but too small to say what it is."
        )
        verdict = _verdict(case, case.base, "none-missing", (), 0.8, (), "", text)
        return verdict, case.base, {}
    named = case.missing(winner)
    if named and precise and explained >= EXPLAINED and winner.heldout_rmse < CLOSE * size:
        return _partly(case, winner, near, explained)
    return _unexplained(case, winner, explained)


def _partly(
    case: _Case, winner: Model, near: Sequence[Model], explained: float
) -> tuple[Verdict, Model, dict[str, float]]:
    named = case.missing(winner)
    alike = tuple(
        case.missing(m) for m in near
        if m is not winner and m is not case.base and len(m.effects) == len(winner.effects)
    )  # fmt: skip
    shares = strength(winner.problem, winner.minimum, named)
    text = (
        f"{_list(named)} {_is(named)} missing: with {_it(named)} the prediction of held-out motion has "
        f"{explained:.0%} less squared error. {_shares(shares)} The sensor is so precise that a rest of "
        f"{winner.rmse / case.noise.std:.0f} times its noise remains; one known effect "
        "more does not cut the error of prediction to a third."
    )
    confidence = 0.9 * explained / (1 + len(alike))
    experiment = _experiment(named, alike)
    return _verdict(case, winner, "missing", named, confidence, alike, experiment, text), winner, shares


def _unexplained(case: _Case, winner: Model, explained: float) -> tuple[Verdict, Model, dict[str, float]]:
    named = case.missing(winner)
    text = "Something is missing that no effect of the catalogue explains, alone, in pairs or in threes. "
    if named:
        text += (
            f"The nearest is {_list(named)}, which takes away {max(explained, 0):.0%} of the squared error but leaves "
            f"a motion that is not noise ({winner.rmse / case.noise.std:.2f} times the noise floor). "
        )
    text += _contradiction(case)
    text += "The map of the missing torque (compare) shows at which angle and rate it acts."
    experiment = (
        "Release from 3°, 7° and 12° to both sides, three times each: what repeats is a law, what does not is "
        "the board changing or the sensor."
    )
    return _verdict(case, winner, "unexplained", (), 0.9, (), experiment, text), winner, {}


def _contradiction(case: _Case) -> str:
    """Say so if every release fits the linear joint alone, each with its own stiffness."""
    from sysid.fit_search import fit_each

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


def _with_record(
    case: _Case,
    winner: Model,
    named: tuple[str, ...],
    alike: Sequence[tuple[str, ...]],
    confidence: float,
    *,
    doubtful: bool,
) -> tuple[Verdict, Model, dict[str, float]]:
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
        return _verdict(case, winner, "none-missing", (), confidence, (), "", text), winner, {}
    text = (
        f"{_list(effects)} {_is(effects)} missing: with {_it(effects)} the residual is {left} and {ratio:.2f} times "
        f"the noise floor (before: {case.base.rmse / case.noise.std:.2f}). {_shares(shares)} {deviation.text}"
    ).strip()
    if doubtful:
        text += " The evidence is thin: the model without it is nearly as likely."
    if sets:
        text += f" These data cannot tell it from {'; or '.join(_list(s) for s in sets)}."
    experiment = deviation.experiment if deviation.effects and not named else _experiment(named, sets)
    verdict = _verdict(case, winner, "missing", effects, confidence, tuple(sets), experiment, text)
    return verdict, winner, shares


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


def _motion_rms(model: Model) -> float:
    rest = model.parameters.get("rest_angle", 0.0)
    signals = [r.signal - (0.0 if r.is_rate else rest) for r in model.problem.records]
    return float(np.sqrt(np.mean(np.concatenate(signals) ** 2)))


def _candidate(case: _Case, model: Model) -> Candidate:
    return Candidate(
        effects=case.missing(model),
        rmse=model.rmse,
        heldout_rmse=model.heldout_rmse if model.heldout is not None else None,
        score=case.scores[model.effects],
        parameters=parameter_quantities(
            model.problem, model.minimum, case.board, certain=model.heldout is not None
        ),
    )


def _verdict(
    case: _Case,
    model: Model,
    status: Status,
    effects: tuple[str, ...],
    confidence: float,
    alike: Sequence[tuple[str, ...]],
    experiment: str,
    text: str,
) -> Verdict:
    unique = dict.fromkeys(tuple(s) for s in alike if set(s) != set(effects))
    return Verdict(
        status=status, effects=effects, confidence=min(max(confidence, 0.0), 0.999),
        indistinguishable_from=tuple(unique), error_before=case.base.rmse, error_after=model.rmse,
        next_experiment=experiment, explanation=text,
    )  # fmt: skip


def _experiment(named: Sequence[str], alike: Sequence[tuple[str, ...]]) -> str:
    """Return the experiment that decides between what is named and what looks like it."""
    others = [name for group in alike for name in group if name not in named]
    for name in (*named, *others):
        part = effect(name)
        if not others or set(part.look_alikes) & {*named, *others} or name in others:
            return part.experiment
    return effect(named[0]).experiment


def _list(names: Sequence[str]) -> str:
    return " and ".join(f"'{name}' ({effect(name).title})" for name in names)


def _is(names: Sequence[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _it(names: Sequence[str]) -> str:
    return "it" if len(names) == 1 else "them"


def _shares(shares: Mapping[str, float]) -> str:
    parts = [f"{name} peaks at {share:.1%} of the joint's torque" for name, share in shares.items()]
    return f"{'; '.join(parts).capitalize()}." if parts else ""
