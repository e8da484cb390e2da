"""What is the model missing? Every candidate a full fit, one score, one judgement.

The score of a candidate is how likely its errors are on motion that it was not fitted to. The simplest one that is not told
from the best is taken, and named if what it adds matters and explains most of what can be explained.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sysid.board import Board
from sysid.decay.plausibility import amplitude_warnings
from sysid.diagnosis import report as diagnosis_report
from sysid.diagnosis.against_record import record_deviation
from sysid.diagnosis.experiment import deciding, widest
from sysid.diagnosis.importance import Importance, importance, reading_share
from sysid.diagnosis.judgement import (
    CALIBRATION,
    CLOSE,
    EXPLAINED,
    MATERIAL,
    NEGLIGIBLE,
    PRICE,
    TEMPERATURE,
    TIE,
    Field,
    Scored,
    calibrated,
    families_of,
    odds,
    rest_of,
)
from sysid.diagnosis.remedy import REACHED, Learned, described, residual_noise, tables
from sysid.diagnosis.report import fittable
from sysid.diagnosis.search import INEXACT, Progress, Search, best_families
from sysid.diagnosis.search import Candidate as Model
from sysid.diagnosis.stretches import judged_stretches
from sysid.diagnosis.surrogates import LAWS, in_words, nearest_outside, surrogates
from sysid.diagnosis.touched import seen_by_hands, untouched
from sysid.diagnosis.wording import (
    experiment_for_a_change,
    experiment_for_the_unknown,
    experiment_in_words,
    is_or_are,
    it_or_them,
    listed,
    percent,
    size_in_words,
    titles,
    unfitted_rival,
)
from sysid.diagnosis.workers import WorkerPool
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.fit_mjcf import Fit
from sysid.fitting.covariance import parameter_quantities
from sysid.fitting.joint import FitOptions, check_parameters, held_parameters, record_priors
from sysid.fitting.records import Signal, make_records, signal_of
from sysid.fitting.search import scales_of
from sysid.joint.structure import structure_of
from sysid.noise.floor import NoiseFloor, held_noise, noise_floor
from sysid.noise.whiteness import correlation_length
from sysid.quantity import Quantity
from sysid.recording import Data, Recording, reading_warnings, unpack
from sysid.roll import Release
from sysid.text import WIDTH
from sysid.workspace import Workspace

if TYPE_CHECKING:
    import pandas as pd

FINALISTS = 6
"""How many of the best sets of families, of single effects and of pairs, are predicted."""
RIVALS = 4
"""How many models that predict as well are listed."""
FAR = 2.0
"""Error over the noise from which a model on the coarse grid will not reach the noise on the fine one: a choice; only time depends on it."""
UNNOTICED = 0.005
"""Error beyond the noise over the motion, both RMS, that nobody misses an effect by which another would take away: of eleven random
logs and a bicycle's fork, what is not there took away 0.002 to 0.004, what is there 0.010 or more."""
SUSPECT = 1.05
"""Error over the noise, with what of it lasts, from which a torque is learned to see whether what is named mimics it: right names leave less
in nine of ten logs. Noise that lasts bends a learned torque: four of 821 random logs, all with such noise, had lost their names to one."""
WEAK = 3.0
"""Log-likelihood [nat] that an effect must gain to be listed as a hint: in one of 21 logs of linear joints the best of all gained so much by
chance, and 2 in three."""
BY_CHANCE = 10_000
"""Logs of releases from rest of which one starts so fast that it is said to have been pushed."""

Status = Literal["none-missing", "missing", "unexplained"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Hint:
    """An effect that is seen, but does not matter, or that may be there, but not beyond doubt."""

    effects: tuple[str, ...]
    size: Importance
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What is missing, how sure that is, and how much it matters."""

    status: Status
    effects: tuple[str, ...]
    families: tuple[str, ...]
    confidence: float
    indistinguishable_from: tuple[tuple[str, ...], ...]
    error_before: float
    error_after: float
    explained: float
    """Share of the squared held-out error beyond the noise that the model takes away."""
    matters: Importance | None
    remainder: float
    """Held-out error beyond the noise that is left [rad or rad/s]."""
    remainder_text: str
    hints: tuple[Hint, ...]
    next_experiment: str
    explanation: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One model that was tried."""

    effects: tuple[str, ...]
    """What it has beyond the board's record."""
    rmse: float
    heldout_rmse: float | None
    """None where the model was out of the running before it came to that."""
    score: float
    """Twice the log-likelihood of held-out motion that the best has more."""
    score_std: float | None
    """Standard deviation of that difference, from period to period; None where it was not predicted."""
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
    """Error of predicting each release or stretch from the others, over its RMS motion: without what is missing."""
    heldout_after: tuple[float, ...]
    """The same with the model that the verdict rests on."""
    stretches: tuple[str, ...]
    """Which release or stretch each of them is: its log, and from when to when."""
    best: Model = field(repr=False)
    base: Model = field(repr=False)
    slides: bool = False
    """Whether the joint slides: roll is its position [m]."""
    swing_frequency: float | None = None
    """Where a rate was fitted, and errors are rates: the joint's natural frequency [rad/s]."""
    learned: Learned | None = None
    """What can be learned of it, where something is left that matters."""
    board: str
    options: tuple[str, ...]
    """How the command line names the joint."""
    fixed: Mapping[str, float]
    """What was held in every model, as it was asked for."""
    releases: int
    """How many were given."""
    is_cut: bool
    """Whether stretches of releases were judged."""
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

    @property
    def ends_at_bound(self) -> bool:
        """Whether a number of what is missing ended at a bound where it may not be left: `fit` would not record it."""
        problem = self.best.problem
        left = {
            f"{e.name}.{p.name}"
            for e in problem.structure.parts
            for p in e.parameters
            if p.default is not None
        }
        ends = zip(problem.names, self.best.minimum.at_bound, strict=False)
        return any(bool(end) for name, end in ends if "." in name and name not in left)

    @property
    def held(self) -> Mapping[str, float]:
        """What `fit` should hold meanwhile: what was held here, and the spring at zero where gravity takes its place."""
        hangs = self.effects and self.best.problem.fixed.get("stiffness") == 0
        return {**self.fixed, **({"stiffness": 0.0} if hangs else {})}

    def report(self, width: int = WIDTH, space: Workspace | None = None, given: Sequence[Path] = ()) -> str:
        """Return what `husky-sysid diagnose` prints, in tables of at most `width` characters.

        Args:
            width: Of the tables.
            space: Where the board is; the current folder, if left out.
            given: Logs, and lists of them, as a command shall name them; those of the releases, if left out.
        """
        return diagnosis_report.report(
            self, width, space or Workspace(Path()), given or tuple(map(Path, self.logs))
        )

    def to_json(self) -> dict[str, Any]:
        """Return what `husky-sysid diagnose --json` writes."""
        return diagnosis_report.to_json(self)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return one row a model, best first: effects, rmse, heldout_rmse [rad or rad/s], score."""
        import pandas as pd

        columns = ("effects", "rmse", "heldout_rmse", "score")
        return pd.DataFrame(
            {
                **{name: getattr(c, name) for name in columns},
                **{name: q.value for name, q in c.parameters.items()},
            }
            for c in self.candidates
        )


def diagnose(
    data: Data,
    board: Board,
    *,
    signal: Signal = "auto",
    fixed: Mapping[str, float] | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> Diagnosis:
    """Fit the catalogue to recordings and judge what the board's record is missing.

    Args:
        data: Free decays of one board: a recording, several, or releases; of one release only, each third of its motion
            is predicted from the others.
        board: The record; its effects are in every model.
        signal: What is fitted.
        fixed: Parameters held in every model, such as {"stiffness": 0.0} for a pendulum.
        workers: Processes; with more than one, a script must guard its main part.
        progress: Called as the search goes on.

    Raises:
        SysidError: The releases are too short, or their unit is wrong.
    """
    recordings, releases, weak = unpack(data)
    with WorkerPool(workers) as pool:  # which loads while the sizes of the problem are found
        chosen = signal_of(releases, signal)
        bias, use_rate = chosen["bias"], chosen["use_rate"]
        noise = noise_floor(releases, rate=use_rate)
        held_still = max(noise.std, held_noise(releases, rate=use_rate))
        scales = scales_of(make_records(releases, noise.std, rate=use_rate), board)
        period = 2 * np.pi / scales.frequency
        warnings = [*weak, *check_releases(releases, board, period)]
        judged, left_out = judged_stretches(releases, period)
        warnings += [left_out] if left_out else []
        records = make_records(judged, noise.std, rate=use_rate)
        options = FitOptions(bias=bias, use_rate=use_rate, fixed=dict(fixed or {}))
        own = [part.name for part in board.effects]
        check_parameters(own, options, board)
        priors = dict[str, tuple[float, float]]()
        if any(effect(name).is_known for name in own):
            held, bias = held_parameters(structure_of(own), board, options)
            priors = record_priors(structure_of(own), board, options, held)
        else:
            held = dict(options.fixed)
            if bias == "per-release" or use_rate:
                held.setdefault("rest_angle", board.rest_angle)
        # A table that was learned stays as it is: no candidate may bend it.
        learned_parts = (part for part in board.effects if effect(part.name).role == "learned")
        held |= {
            f"{part.name}.{name}": q.value for part in learned_parts for name, q in part.parameters.items()
        }
        search = Search(
            records=records, scales=scales, bias=bias, base=tuple(sorted(p.name for p in board.effects)),
            fixed=held, priors=priors, pool=pool, progress=progress,
        )  # fmt: skip
        started, (search, models) = search, _searched(search)
        learning = partial(tables, judged, board, signal=signal, fixed=fixed)
        # Begun as soon as it is clear that it will be wanted, while others work on the rest.
        beyond = _beyond(search, models)
        alone = pool.begin(partial(learning, whole=beyond > MATERIAL), ()) if beyond else None
        final = _finalists(search, models)
        left = untouched([*final, *_outside_all(search, final)], search.base, pool, held_still / noise.std)
        if left is not None:
            kept, left_out = left
            again, others, last = _searched_anew(started, kept)
            # A hand was there if what it did not touch is by a law: a narrower swing alone is nearer to any.
            if min(m.rmse for m in last) < REACHED * held_still:
                warnings.append(left_out)
                judged, search, models, final = kept, again, others, last
                learning, alone = partial(tables, judged, board, signal=signal, fixed=fixed), None
            else:
                left = None
        final = search.foretold(final)
        first = Field(final, search.base, period, noise.std)
        alone = alone or _learning_begun(pool, learning, first)
        decided = _decided(search, first, final, board)
        if left is None and (seen := seen_by_hands(search, decided.asked, decided.everything)) is not None:
            kept, left_out = seen
            again, others, last = _searched_anew(started, kept)
            last = again.foretold(last)
            other = _decided(again, Field(last, again.base, period, noise.std), last, board)
            if other.laws < decided.laws:
                warnings.append(left_out)
                judged, search, models, final, decided = kept, again, others, other.final, other
                learning, alone = partial(tables, judged, board, signal=signal, fixed=fixed), None
        winner, final, everything, verdict, best, quantities = (
            decided.winner, decided.final, decided.everything, decided.verdict, decided.best, decided.quantities,
        )  # fmt: skip
        base = search.fine(everything.base.model, average=1)
        verdict = replace(verdict, error_before=base.rmse, error_after=best.rmse)
        left_over = verdict.remainder > MATERIAL * everything.motion and everything.surely_missing
        left_over |= verdict.status == "unexplained"
        left_over &= not decided.changes  # a torque of tilt and rate stands for none that changes
        # What is named may only mimic a law that nobody has met, alone or beside another. Noise that lasts is no law's.
        mimics = verdict.status == "missing" and best.rmse > SUSPECT * max(noise.std, everything.noise)
        learned = None
        named = fittable(verdict.effects) if left_over else ()
        results: list[tuple[tuple[str, ...], Callable[[], Fit | None]]] = []
        if left_over or mimics:
            results.append(((), alone or pool.begin(learning, ())))
        if named:
            results.append((named, pool.begin(partial(learning, whole=True), named)))
        # At the same time by several processes; by one alone no more than is asked for.
        for beside, result in results:
            found = result()
            offered = left_over and beside == named
            if found is not None and (offered or residual_noise(found) < REACHED * noise.std):
                learned = described(found, beside)
            else:
                learned = None
            if mimics and learned is not None and _is_unmet(learned, winner, best, everything):
                verdict = _unmet(verdict, learned, best, board)
                break
        else:
            learned = learned if left_over else None
    if learned is not None and learned.error_after > verdict.error_after:
        learned = None  # it did not get there
    if progress is not None:
        progress("done", 1.0)
    warnings += _fast_starts(best)
    scores = {
        (s.model.effects, s.model.shape): 2 * (everything.best.score - s.score) for s in everything.scored
    }
    spreads = {s.model.effects: everything.spread(s) for s in everything.scored if not s.model.shape}
    ranked = sorted(final, key=lambda m: scores[m.effects, ""])
    done = {m.effects for m in final}
    others = sorted((m for m in models if m.effects not in done), key=lambda m: m.cost)

    def shown(model: Model, score: float) -> Candidate:
        numbers = quantities.get(id(model)) or partial(
            parameter_quantities, model.problem, model.minimum, board, certain=model.effects in done
        )
        return Candidate(
            effects=search.added(model), rmse=model.rmse, score=score,
            score_std=spreads.get(model.effects),
            heldout_rmse=model.heldout_rmse if model.heldout is not None else None,
            parameters=numbers(),
        )  # fmt: skip

    worst = max((s for s in scores.values() if np.isfinite(s)), default=0.0)
    return Diagnosis(
        noise=noise,
        baseline=shown(everything.base.model, scores[search.base, ""]),
        candidates=(
            *(shown(m, scores[m.effects, ""]) for m in ranked),
            *(shown(m, worst + m.cost - others[0].cost) for m in others),
        ),
        verdict=replace(verdict, error_after=learned.error_after) if learned else verdict,
        learned=learned,
        shares={} if verdict.matters is None else verdict.matters.each,
        doubts=tuple(warnings),
        board=board.name,
        options=board.options,
        fixed=dict(fixed or {}),
        releases=len(releases),
        is_cut=not {_span(release) for release in judged} <= {_span(release) for release in releases},
        recordings=recordings,
        logs=tuple(dict.fromkeys(release.log for release in releases)),
        heldout_before=heldout_nrmse(everything.base.model),
        heldout_after=heldout_nrmse(winner),
        stretches=tuple(
            f"{Path(log).name}, {begin:.2f} to {end:.2f} s" for log, begin, end in map(_span, judged)
        ),
        best=best,
        base=base,
        slides=board.slides,
        swing_frequency=scales.frequency if use_rate else None,
    )


def check_releases(releases: Sequence[Release], board: Board, period: float) -> list[str]:
    """Refuse what no verdict can be made from, and say what looks odd.

    Raises:
        SysidError: Angles that cannot be radians of a board, or releases shorter than a swing.
    """
    warnings = amplitude_warnings(releases, board)
    longest = max(float(r.time[-1] - r.time[0]) for r in releases)
    samples = sum(len(r.time) for r in releases)
    if longest < 0.6 * period or samples < 24:
        raise SysidError(
            f"the releases have {samples} samples, the longest {longest:.3g} s of them, and one swing takes {period:.3g} s: "
            "too short for a verdict. Record until the deck rests, and three releases or more."
        )
    if len(releases) == 1:
        warnings.append(
            "one release only: each third of its motion was predicted from the others. Three releases "
            "from different angles, to both sides, make a much stronger test"
        )
    return warnings


def _span(release: Release) -> tuple[str, float, float]:
    return release.log, float(release.time[0]), float(release.time[-1])


def heldout_nrmse(model: Model) -> tuple[float, ...]:
    """Return the error of prediction over the RMS of the motion about rest, for each release that was left out.

    Of one release alone it is that of its thirds, each predicted from the others.
    """
    rest = rest_of(model)
    errors: list[float] = []
    for missed, measured in zip(model.heldout or (), model.problem.observed, strict=False):
        motion = measured[-len(missed) :] - rest
        errors.append(float(np.sqrt(np.mean(missed**2) / max(float(np.mean(motion**2)), 1e-300))))
    return tuple(errors)


def _fast_starts(model: Model) -> list[str]:
    """Say so if releases from a hold start faster than releases from rest do in one of `BY_CHANCE` logs."""
    from scipy.special import chdtri

    problem = model.problem
    excess = problem.too_fast(model.minimum.point, model.rmse / problem.records[0].std)
    if excess < chdtri(len(problem.records), 1 / BY_CHANCE):
        return []
    return [
        "the deck leaves the hand faster than the model allows: it was pushed, or something acts in the first "
        "milliseconds only, such as an end stop that the deck was held against. Release from smaller angles too"
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Decided:
    """The verdict on what was searched, and what it rests on."""

    winner: Model
    """As it was scored."""
    final: Sequence[Model]
    everything: Field
    verdict: Verdict
    best: Model
    """The model that the verdict rests on, fitted to single samples."""
    quantities: Mapping[int, Callable[[], Mapping[str, Quantity]]]
    """Of the finalists, by their identity."""
    asked: Sequence[Model]
    """What is said to be missing, then what has less; empty where nothing is missing."""
    laws: float
    """How many are missing; inf where none of the catalogue explains it."""
    changes: bool
    """Whether what is said is another law later, or in another release, which no torque of tilt and rate is."""


def _decided(search: Search, tried: Field, final: list[Model], board: Board) -> _Decided:
    """Return the verdict on models that were predicted."""
    quantities = {id(m): search.pool.begin(parameter_quantities, m.problem, m.minimum, board) for m in final}
    winner, final, idle = _material(search, tried, final, board)
    outside = surrogates(search, winner, min(final, key=lambda m: m.cost))
    everything = Field([*final, *outside], search.base, tried.period, tried.floor, known=tried)
    verdict, best, beyond = _judged(search, everything, winner, board, idle)
    asked: list[Model] = []
    if beyond is not None or (verdict.status != "none-missing" and search.added(winner)):
        said = winner if beyond is None else beyond.model
        asked = [said, *(m for m in final if m is not said and set(m.effects) <= set(winner.effects))]
    named = 0 if verdict.status == "none-missing" else len(search.added(winner))
    return _Decided(
        winner=winner, final=final, everything=everything, verdict=verdict, best=best, quantities=quantities, asked=asked,
        laws=np.inf if verdict.status == "unexplained" else named, changes=_changes(beyond),
    )  # fmt: skip


def _searched_anew(search: Search, releases: Sequence[Release]) -> tuple[Search, list[Model], list[Model]]:
    """Return what searches some other releases, all models that were fitted to them, and those that may win."""
    record = search.records[0]
    search, models = _searched(
        replace(search, records=make_records(releases, record.std, rate=record.is_rate))
    )
    return search, models, _finalists(search, models)


def _searched(search: Search) -> tuple[Search, list[Model]]:
    """Return what searches, and all models that were fitted."""
    search, singles = search.hung(search.singles())
    singles = search.simplified(singles[1:], singles)
    # What is at the noise already needs nothing beside it, so what else could be is asked for in its pairs, and in what is as simple.
    reached = search.at_noise(singles)
    pairs = search.pairs(singles, reached)
    best = min(pairs, key=lambda m: m.cost)
    near = [] if reached else search.neighbours(best, [*singles, *pairs])
    near += search.kinked(singles, reached)
    models = sorted([*singles, *pairs, *near], key=lambda m: m.cost, reverse=True)
    models = list({m.effects: m for m in models}.values())
    large = sorted([*pairs, *near], key=lambda m: m.cost)[:4]
    models = search.reduced(large, models)
    return search, [reached if reached and m.effects == reached.effects else m for m in models]


def _beyond(search: Search, models: Sequence[Model]) -> float:
    """Return the error over the motion, both RMS, of the best model, if what is missing matters and none will reach the noise on the fine grid; else 0."""
    linear = next(m for m in models if m.effects == search.base)
    motion = float(np.sqrt(np.mean((np.concatenate(linear.problem.observed) - rest_of(linear)) ** 2)))
    best = min(models, key=lambda m: m.cost)
    far = linear.rmse > MATERIAL * motion and best.rmse > FAR * search.records[0].std
    return best.rmse / motion if far else 0.0


def _learning_begun(
    pool: WorkerPool, learning: Callable[..., Fit | None], tried: Field
) -> Callable[[], Fit | None] | None:
    """Begin to learn what will be asked for in the end, while others work on the rest; None where it may not be."""
    ahead = tried.winner()
    if not tried.surely_missing or ahead.model.rmse <= SUSPECT * tried.floor:
        return None
    return pool.begin(partial(learning, whole=tried.left(ahead) > MATERIAL), ())


def _outside_all(search: Search, models: Sequence[Model]) -> list[Model]:
    """Return the law outside the catalogue that comes nearest to all of the motion, where none of the catalogue reaches the noise."""
    best = min(models, key=lambda m: m.cost)
    return [nearest_outside(search, best)] if best.rmse > REACHED * search.records[0].std else []


def _finalists(search: Search, models: Sequence[Model]) -> list[Model]:
    """Return those models that may win, refined and not predicted yet."""
    linear = next(m for m in models if m.effects == search.base)
    picked = [linear]
    for count in (1, 2):
        extra = [m for m in models if len(m.effects) - len(search.base) == count]
        picked += best_families(extra, FINALISTS)
    return search.finalists(picked)


def _material(
    search: Search, tried: Field, final: list[Model], board: Board
) -> tuple[Model, list[Model], frozenset[str]]:
    """Return the winner without those of its effects that do not matter, all finalists, and the families left out."""

    def moved(model: Model) -> int:
        return len(record_deviation(model, board, look_at_linear=False).effects)

    winner, left_out = tried.winner(moved).model, frozenset[str]()

    def less(name: str) -> Model:
        rest = tuple(n for n in winner.effects if n != name)
        known = [m for m in final if m.effects == rest]
        return min([*known, search.finalist(search.without(winner, rest, [{}]))], key=lambda m: m.cost)

    def idles(name: str, beside: Model) -> bool:
        # Of many samples a small error is lost in each one, and not in the means that are scored.
        missed = winner.heldout_rmse < INEXACT * tried.noise < beside.heldout_rmse
        sure = (beside.rmse > tried.exact or missed) and not tried.inexact
        unnoticed = not sure and tried.left(tried.score(beside)) < UNNOTICED
        return unnoticed or not importance(winner, [name], beside).matters

    while len(named := search.added(winner)) > 1:
        beside = {name: less(name) for name in named}
        idle = max(
            (name for name in named if idles(name, beside[name])),
            key=lambda name: tried.score(beside[name]).score, default=None,
        )  # fmt: skip
        if idle is None:  # of two either of which would do, the worse one goes
            break
        known = beside[idle]
        final = [*(m for m in final if m.effects != known.effects), known]
        if tried.left(tried.score(known)) > max(MATERIAL, 1.01 * tried.left(tried.score(winner))):
            break
        winner, left_out = known, left_out | {effect(idle).family}
    return winner, final, left_out


def _judged(
    search: Search, tried: Field, winner: Model, board: Board, idle: frozenset[str]
) -> tuple[Verdict, Model, Scored | None]:
    """Return the verdict, the model that it rests on, fitted to single samples, and the law outside the catalogue that it says, if any."""
    base = tried.base
    chosen = next(s for s in tried.scored if s.model is winner)
    named = search.added(winner)
    size = importance(winner, named, base.model) if named and not tried.slight else None
    if size is not None and all(
        families_of(chosen.model, search.base) <= families_of(s.model, search.base)
        for s in tried.near(chosen)
        if s.choices <= chosen.choices
    ):
        # A lag that the joint seems to have none of is one of the reading, if nothing as simple does as well.
        size = replace(size, signal_share=max(size.signal_share, reading_share(chosen.model, named)))
    explained = tried.explained(chosen)
    named_else = size is not None and size.matters and explained >= EXPLAINED
    outside = None if tried.slight else _outside(tried, chosen, named=named_else)
    hints = _hints(search, tried, chosen, size)
    if outside is not None or (tried.surely_missing and not tried.explains(chosen)):
        return *_unexplained(search, tried, chosen, outside, hints, board), outside
    if not named_else:
        return *_nothing(search, tried, chosen, size, hints, board), None
    assert size is not None
    return *_missing(search, tried, chosen, size, hints, board, idle), None


def _outside(tried: Field, chosen: Scored, *, named: bool) -> Scored | None:
    """Return a law outside the catalogue that reaches the noise and is the likelier one, if there is one.

    Where an effect would be named it must beat all that was tried; else it must beat beyond doubt that nothing is missing, also by
    what its numbers cost: a spring and a damper of its own in each of five releases are ten.
    """
    shaped = [s for s in tried.scored if s.model.shape and s.model.rmse < tried.exact]
    best = max(shaped, key=odds, default=None)
    if best is None:
        return None
    if named or (chosen.extra and tried.surely_missing):
        others = max((odds(s) for s in tried.possible if not s.model.shape), default=-np.inf)
        return best if odds(best) > others else None
    if odds(best) <= odds(tried.base):
        return None
    return best if best.score - chosen.score > 2 * TIE and tried.gap(best, chosen) > TIE else None


def _hints(search: Search, tried: Field, chosen: Scored, size: Importance | None) -> tuple[Hint, ...]:
    """Return single effects that show, beside what is named if that matters, but are not sure or too weak to be named."""
    beside = chosen if chosen.extra and size is not None and size.matters else tried.base
    hints: list[Hint] = []
    for s in sorted(tried.scored, key=lambda s: -s.score):
        names = tuple(n for n in s.model.effects if n not in beside.model.effects)
        richer = set(beside.model.effects) < set(s.model.effects)
        gained = s.score - beside.score
        if not richer or len(names) != 1 or s.model.shape or gained < WEAK or len(hints) == 3:
            continue
        weight = importance(s.model, names, beside.model)
        if beside is tried.base or weight.matters:
            seen = "may be there" if weight.matters or tried.gap(s, beside) <= TIE else "is seen"
            size_of_it = "and would matter" if weight.matters else "too weak to matter"
            text = f"{listed(names)} {seen}, {size_of_it} (score better by {2 * gained:.1f}). {size_in_words(weight)}"
            hints.append(Hint(effects=names, size=weight, text=text))
    return tuple(hints)


def _missing(
    search: Search, tried: Field, chosen: Scored, size: Importance, hints: tuple[Hint, ...], board: Board,
    idle: frozenset[str],
) -> tuple[Verdict, Model]:  # fmt: skip
    final = search.fine(chosen.model, average=1)
    named = search.added(chosen.model)
    deviation = record_deviation(final, board, look_at_linear=False)
    # What is richer is a rival only if it is likelier for sure, were it not that no model is exact; with what was chosen in it, never.
    likeliest = max(tried.possible, key=lambda s: s.score)
    rivals = [
        s for s in sorted(tried.near(chosen), key=lambda s: -s.score)
        if s.extra and not s.model.shape and s is not chosen and tried.explained(s) >= EXPLAINED
        and (s.extra <= chosen.extra or (s is likeliest and s.score > chosen.score + TIE))
        and not tried.adds_to(s, chosen)
    ][:RIVALS]  # fmt: skip
    effects = (*named, *deviation.effects)
    sets = [
        (*search.added(s.model), *record_deviation(s.model, board, look_at_linear=False).effects)
        for s in rivals
    ] + [(*named, *other) for other in deviation.alike]
    explained = tried.explained(chosen)
    text = (
        f"{listed(effects)} {is_or_are(effects)} missing: {percent(explained)} of the squared error of predicting held-out "
        f"motion, beyond the noise, goes away with {it_or_them(effects)}. {size_in_words(size)} {deviation.text}"
    ).strip()
    if sets:
        text += f" These data cannot tell it from {'; or '.join(listed(s) for s in sets)}."
    unmet = [s for s in tried.near(chosen) if s.model.shape and s.extra <= chosen.extra]
    if unmet:
        best = max(unmet, key=lambda s: s.score)
        text += f" Outside the catalogue, {in_words(best.model, slides=board.slides)} would do as well."
    if tried.base in tried.near(chosen):
        text += " The evidence is thin: the model without it is nearly as likely."
    text += "".join(f" Beside it, {hint.text}" for hint in hints)
    # Where no model is exact, the rest may be the mark of another law.
    confidence = tried.confidence(families_of(chosen.model, search.base), idle) / (1 + tried.unmet(chosen))
    experiment = _experiment(search, tried, chosen, board, rivals)
    return _verdict(tried, "missing", effects, confidence, sets, chosen, size, hints, experiment, text), final


def _nothing(
    search: Search,
    tried: Field,
    chosen: Scored,
    size: Importance | None,
    hints: tuple[Hint, ...],
    board: Board,
) -> tuple[Verdict, Model]:
    final = search.fine(tried.base.model, average=1)
    deviation = record_deviation(final, board, look_at_linear=True)
    if tried.slight:  # whatever it is
        confidence = tried.chance_explained(tried.base, 0.0, NEGLIGIBLE)
    else:
        confidence = sum(
            tried.confidence(f) for f in {frozenset[str](), families_of(chosen.model, search.base)}
        )
    experiment = deviation.experiment
    if deviation.effects:
        status: Status = "missing"
        text = f"{listed(deviation.effects)} {is_or_are(deviation.effects)} missing. {deviation.text}"
    else:
        status = "none-missing"
        few = ", too little of too few periods to say of what" if tried.slight else ""
        would = any(hint.size.matters for hint in hints) and not few
        text = (
            f"Nothing is missing {'beyond doubt' if would else 'that matters'}{few}. {deviation.text}".strip()
        )
        seen = {hint.effects for hint in hints}
        named = search.added(chosen.model)
        if size is not None and size.matters:
            text += f" {listed(named)} takes away only {percent(tried.explained(chosen))} of the squared error of prediction."
        elif size is not None and named not in seen:
            text += f" {listed(named)} {is_or_are(named)} seen, too weak to matter. {size_in_words(size)}"
        alike = [s for s in tried.scored if search.added(s.model) in seen and not s.model.shape]
        experiment = _experiment(search, tried, tried.base, board, alike) if alike else ""
    for hint in hints:
        text += f" Hint: {hint.text}"
    said = (status, deviation.effects, confidence, deviation.alike)
    return _verdict(tried, *said, tried.base, None, hints, experiment, text), final


def _unexplained(
    search: Search,
    tried: Field,
    chosen: Scored,
    outside: Scored | None,
    hints: tuple[Hint, ...],
    board: Board,
) -> tuple[Verdict, Model]:
    final = search.fine(chosen.model, average=1)
    named = search.added(chosen.model)
    explained = tried.explained(chosen)
    text = "Something is missing that no effect of the catalogue explains. "
    if named:
        text += f"The nearest is {listed(named)}, which takes away {percent(explained)} of the squared error of prediction. "
    if outside is not None:
        beside = search.added(outside.model)
        also = f", beside {listed(beside)}," if beside else ""
        words = in_words(outside.model, slides=board.slides)
        text += f"{words[:1].upper()}{words[1:]}{also} does it better. "
        confidence = sum(p for families, p in tried.likely().items() if families & LAWS.keys())
    elif named:
        confidence = 1 - tried.chance_explained(chosen, EXPLAINED, CLOSE)
        if tried.is_stood_in_for:
            confidence = max(confidence, 1 / (1 + np.exp(-tried.gap(tried.best, chosen) / TEMPERATURE)))
    else:
        confidence = tried.confidence(frozenset())
    text += "The map of the missing torque (compare) shows at which angle and rate it acts."
    # Two laws that are both wrong predict none.
    experiment = experiment_for_a_change() if _changes(outside) else _for_the_unknown(chosen.model, board)
    return _verdict(tried, "unexplained", (), confidence, (), chosen, None, hints, experiment, text), final


def _changes(outside: Scored | None) -> bool:
    """Return whether a law outside the catalogue, if one is said, is another one later or in another release."""
    return outside is not None and LAWS[outside.model.shape].changes


def _for_the_unknown(model: Model, board: Board) -> str:
    return experiment_for_the_unknown(model.problem.scales.amplitude, widest(model, board), board)


def _is_unmet(learned: Learned, winner: Model, named: Model, tried: Field) -> bool:
    """Return whether a learned torque shows that what was named only mimics it.

    A simple law beside something that nobody misses is as likely as one that nobody has met; one of many numbers is not.

    Args:
        learned: The torque.
        winner: What was named, as it was scored.
        named: The same, fitted to single samples.
        tried: All that was scored.
    """
    choices = next(s.choices for s in tried.scored if s.model is winner)
    enough = UNNOTICED * tried.motion if PRICE * choices < TIE else 0.0
    return learned.is_unmet(named.rmse, _independent(named), tried.floor, enough)


def _independent(model: Model) -> float:
    """Return how many of a model's residuals are independent."""
    return model.samples / max(correlation_length(model.residuals), 1.0)


def _unmet(verdict: Verdict, alone: Learned, named: Model, board: Board) -> Verdict:
    """Return the verdict where a learned torque has shown that what was named only mimics it."""
    odds = alone.gain(named.rmse, _independent(named))
    better = "one formula" if alone.formula else "a smooth torque of tilt and rate"
    return replace(
        verdict, status="unexplained", effects=(), families=(), indistinguishable_from=(), matters=None, hints=(),
        next_experiment=_for_the_unknown(named, board),
        confidence=float(calibrated(1 / (1 + np.exp(-np.asarray(odds))), *CALIBRATION["unexplained"])),
        explanation=(
            "Something is missing that no effect of the catalogue explains. The nearest is "
            f"{listed(verdict.effects)}, which takes away {percent(verdict.explained)} of the squared error of prediction; "
            f"{better} that the catalogue lacks does it better, to the noise. The map of the missing torque (compare) shows at which "
            "angle and rate it acts."
        ),
    )  # fmt: skip


def _remainder(tried: Field, scored: Scored) -> tuple[float, str]:
    """Return the held-out error beyond the noise, and where most of it is."""
    left = float(np.sqrt(max(tried.excess(scored), 0.0)))
    share = left / max(tried.motion, 1e-300)
    if share < 0.002 or left < 0.1 * tried.noise:
        return left, "What is left is the noise of the sensor."
    return left, f"What is left is {percent(share)} of the motion."


def _experiment(
    search: Search, tried: Field, chosen: Scored, board: Board, alike: Sequence[Scored] = ()
) -> str:
    """Return the experiment that decides between a candidate and its best rival, of another family if any is; '' if all are ruled out."""
    own = families_of(chosen.model, search.base)
    unlike = [s for s in alike if families_of(s.model, search.base) != own]
    rival = next(iter([*unlike, *tried.rivals(chosen), *alike]), None)
    if rival is None:
        return " ".join(unfitted_rival(name) for name in search.added(chosen.model)).strip()
    names = [search.added(s.model) for s in (chosen, rival)]
    limit = widest(chosen.model, board)
    found = deciding(chosen.model, rival.model, tried.best.errors, limit)
    apart = next((name for name in (*names[1], *names[0]) if name not in set(names[0]) & set(names[1])), "")
    fallback = "" if found or not apart else board.experiment(apart, limit)
    return experiment_in_words(found, titles(names[0]), titles(names[1]), fallback, board, limit)


def _verdict(
    tried: Field, status: Status, effects: Sequence[str], confidence: float, alike: Sequence[tuple[str, ...]], chosen: Scored,
    size: Importance | None, hints: tuple[Hint, ...], experiment: str, text: str,
) -> Verdict:  # fmt: skip
    remainder, words = _remainder(tried, chosen)
    unique = dict.fromkeys(tuple(s) for s in alike if set(s) != set(effects))
    return Verdict(
        status=status, effects=tuple(effects), families=tuple(sorted({effect(n).family for n in effects})),
        confidence=float(calibrated(np.asarray(confidence), *CALIBRATION[status])),
        indistinguishable_from=tuple(unique), error_before=tried.base.model.rmse, error_after=chosen.model.rmse,
        explained=tried.explained(chosen), matters=size, remainder=remainder, remainder_text=words, hints=hints,
        next_experiment=experiment, explanation=f"{text.strip()} {words}",
    )  # fmt: skip
