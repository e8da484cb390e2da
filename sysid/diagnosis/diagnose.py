"""What is the model missing? A verdict that the data can defend, or none.

Two cases, told apart by the residual of the best model. If it is white, the noise is all that is left
and likelihood may judge: an effect is named if it pays for its parameters and for having been picked
from a catalogue (extended BIC). If not, no likelihood holds; then only what predicts other releases
counts, and the simplest model within one standard error of the best prediction is taken.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.board import Board
from sysid.decay.plausibility import amplitude_warnings
from sysid.diagnosis import report as diagnosis_report
from sysid.diagnosis.by_likelihood import judge_noise, likeliest
from sysid.diagnosis.by_prediction import judge_prediction
from sysid.diagnosis.report import fittable
from sysid.diagnosis.residual_tests import WHITE, noise_left, whiteness
from sysid.diagnosis.scores import extended_bic, yardstick
from sysid.diagnosis.search import Model, Progress, Searcher
from sysid.diagnosis.verdict import Case, Judgement, Status, Verdict, heldout_nrmse
from sysid.diagnosis.workers import Crew
from sysid.errors import HuskyError
from sysid.fitting.covariance import parameter_quantities
from sysid.fitting.records import Signal, make_records, signal_of
from sysid.fitting.search import scales_of
from sysid.noise.floor import NoiseFloor, noise_floor
from sysid.quantity import Quantity
from sysid.recording import Data, Recording, reading_warnings, unpack
from sysid.roll import Release
from sysid.text import WIDTH

if TYPE_CHECKING:
    import pandas as pd

FAR = 30.0
"""Difference of score while screening from which a model is out of the running."""


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
class Diagnosis:
    """All that was found."""

    noise: NoiseFloor
    baseline: Candidate
    candidates: tuple[Candidate, ...]
    """Best first."""
    verdict: Verdict
    shares: Mapping[str, float]
    """Peak torque of each missing effect over the peak torque of the joint."""
    doubts: tuple[str, ...]
    """What is odd about the releases for this board, or doubtful about the verdict."""
    heldout_before: tuple[float, ...]
    """Error of predicting each release from the others, over its RMS motion: without what is missing."""
    heldout_after: tuple[float, ...]
    """The same with the model that the verdict rests on."""
    best: Model = field(repr=False)
    base: Model = field(repr=False)
    swing_frequency: float | None = None
    """Where a rate was fitted, and errors are rates: the joint's natural frequency [rad/s]."""
    board: str
    releases: int
    """How many were judged."""
    recordings: tuple[Recording, ...] = ()
    """The logs, where they were given whole."""
    logs: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is wrong with the logs, or doubtful about them for this board and this verdict."""
        return (*reading_warnings(self.recordings), *self.doubts)

    @property
    def status(self) -> Status:
        """'none-missing', 'missing' or 'unexplained'."""
        return self.verdict.status

    @property
    def effects(self) -> tuple[str, ...]:
        """What `fit` should add: the effects that are missing, if the verdict names any."""
        return fittable(self.verdict.effects) if self.status == "missing" else ()

    def report(self, width: int = WIDTH) -> str:
        """Return what `husky-sysid diagnose` prints, in tables of at most `width` characters."""
        return diagnosis_report.report(self, width)

    def to_json(self) -> dict[str, Any]:
        """Return what `husky-sysid diagnose --json` writes."""
        return diagnosis_report.to_json(self)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return one row a model, best first: effects, rmse, heldout_rmse [rad or rad/s], score."""
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "effects": c.effects,
                    "rmse": c.rmse,
                    "heldout_rmse": c.heldout_rmse,
                    "score": c.score,
                    **{name: quantity.value for name, quantity in c.parameters.items()},
                }
                for c in self.candidates
            ]
        )


def diagnose(
    data: Data,
    board: Board,
    *,
    signal: Signal = "auto",
    workers: int = 1,
    progress: Progress | None = None,
) -> Diagnosis:
    """Fit the catalogue to recordings and judge what the board's record is missing.

    Args:
        data: Free decays of one board: a recording, several, or releases; of one release only, its second half is
            predicted from its first.
        board: The record; its effects are in every model.
        signal: What is fitted.
        workers: Processes; with more than one, a script must guard its main part.
        progress: Called as the search goes on.

    Raises:
        HuskyError: The releases are too short, or their unit is wrong.
    """
    recordings, releases = unpack(data)
    chosen = signal_of(releases, signal)
    bias, use_rate = chosen["bias"], chosen["use_rate"]
    noise = noise_floor(releases, rate=use_rate)
    records = make_records(releases, noise.std, rate=use_rate)
    scales = scales_of(records, board)
    period = 2 * np.pi / scales.frequency
    warnings = check_releases(releases, board, period)
    with Crew(workers) as crew:
        searcher = Searcher(
            records=records, scales=scales, bias=bias, base=tuple(sorted(p.name for p in board.effects)),
            fixed={"rest_angle": board.rest_angle} if bias == "per-release" or use_rate else {},
            crew=crew, progress=progress,
        )  # fmt: skip
        models, final = _search(searcher, period)
    base = next(m for m in final if m.effects == searcher.base)
    rule = yardstick(final, len(searcher.names()))
    scores = extended_bic(final, models, rule)
    final.sort(key=lambda m: scores[m.effects])
    noise = noise_left(final[0], noise, period)
    case = Case(board, searcher, base, final, scores, rule, noise, period)
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
        doubts=tuple(warnings),
        board=board.name,
        releases=len(releases),
        recordings=recordings,
        logs=tuple(dict.fromkeys(release.log for release in releases)),
        heldout_before=heldout_nrmse(base),
        heldout_after=heldout_nrmse(best),
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
    by_cost = sorted(models, key=lambda m: m.chi2)
    large = [m for m in by_cost if len(m.effects) > len(searcher.base) + 1]
    models = searcher.reduced([*large[:4], *ranked[:2]], models)
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
    scores = extended_bic(models, models, yardstick(models, len(searcher.names())))
    ranked = sorted(models, key=lambda m: scores[m.effects])
    picked.update({m.effects: m for m in ranked[:5]})
    if whiteness(by_cost[0], 2 * np.pi / searcher.scales.frequency) > WHITE:
        # The best is at the noise: what is this much less likely need not be refined to be told from it.
        kept = {base.effects, *(m.effects for m in ranked[:2])}
        picked = {k: m for k, m in picked.items() if k in kept or scores[k] < scores[ranked[0].effects] + FAR}
    jobs = [(model,) for model in picked.values()]
    return searcher.each("predicting what was held out", Searcher.finalist, jobs, 0.85, 0.99)


def _judge(case: Case) -> Judgement:
    winner = likeliest(case)
    return judge_prediction(case) if winner is None else judge_noise(case, winner)


def _candidate(case: Case, model: Model) -> Candidate:
    return Candidate(
        effects=case.missing(model),
        rmse=model.rmse,
        heldout_rmse=model.heldout_rmse if model.heldout is not None else None,
        score=case.scores[model.effects],
        parameters=parameter_quantities(
            model.problem,
            model.minimum,
            case.board,
            certain=model.heldout is not None and bool(np.isfinite(model.minimum.normal.cost)),
        ),
    )
