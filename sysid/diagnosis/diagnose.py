"""Which effect is missing: evidence for sets of laws, then fits of the likeliest ones.

The posterior (`posterior`, `slow_flow`) names families with probabilities. The likeliest sets are then fitted by output error, by the
code of `fit`: those fits give errors, held-out errors, and parameters with intervals.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.board import Board
from sysid.decay.plausibility import amplitude_warnings
from sysid.diagnosis import report as diagnosis_report
from sysid.diagnosis.exact import is_possible, sizes_of, weigh
from sysid.diagnosis.experiment import deciding, in_words
from sysid.diagnosis.laws import candidates
from sysid.diagnosis.motion import NODES, judged_part, motion_of
from sysid.diagnosis.posterior import Found, Posterior, Subject, posterior
from sysid.diagnosis.record import record_deviation
from sysid.diagnosis.slow_flow import slow_posterior
from sysid.diagnosis.verdict import NAMELESS, Hint, Status, Verdict, decide
from sysid.diagnosis.walk import error_beside, likeliest_gain
from sysid.effects import effect
from sysid.effects._base import TorqueEffect
from sysid.errors import SysidError
from sysid.fitting.joint import FitOptions, Trial, check_parameters, fit_joint, trial_fit
from sysid.fitting.records import signal_of
from sysid.fitting.result import JointFit
from sysid.noise.floor import NoiseFloor, noise_floor
from sysid.progress import Listener, listening, stage
from sysid.quantity import Quantity
from sysid.recording import Data, Recording, reading_warnings, unpack
from sysid.roll import Release
from sysid.shown import Shown
from sysid.text import WIDTH
from sysid.workspace import Workspace

if TYPE_CHECKING:
    import pandas as pd

FITTED, MOST_FITS = 5, 8
"""Sets of the posterior that compete, and sets that are fitted in full."""
BENDS = 0.2
"""Share by which a parameter has to lower the error beyond the noise. No law is exact: each may be off by a tenth of its torque."""
EVEN = 0.5
"""Probability from which a family is taken to act."""
SURE = 0.9
"""Probability of a set from which the equations decide."""
STOP_LIKELY = 0.2
"""Probability of a stop from which the grid is twice as fine: a stiff stop is met and left within a few nodes."""

LONGEST = 2000
"""Characters of a diagnosis as an interpreter shows it."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One set of effects, fitted."""

    effects: tuple[str, ...]
    """Beside the record's own."""
    score: float
    """Twice the log evidence below the best."""
    fit: JointFit = field(repr=False)
    judged: float
    """RMS residual beside a walk of the sensor's zero [rad or rad/s]."""

    @property
    def rmse(self) -> float:
        """Root mean square residual [rad or rad/s]."""
        return self.fit.rmse

    @property
    def beyond(self) -> float:
        """Judged error beyond the noise [rad or rad/s]."""
        return float(np.sqrt(max(self.judged**2 - self.fit.noise.std**2, 0.0)))

    @property
    def reaches_noise(self) -> bool:
        """Whether the judged error is within the 95 % interval of the noise."""
        return self.judged <= self.fit.noise.highest

    @property
    def cost(self) -> float:
        """Log error beyond the noise, and what the parameters have to be worth."""
        return _cost(self.effects, self.judged / self.fit.noise.std, self.fit.noise)

    @cached_property
    def heldout_rmse(self) -> float:
        """Error on releases that the fit did not see [rad or rad/s]."""
        return self.fit.heldout_rmse()

    @property
    def parameters(self) -> Mapping[str, Quantity]:
        """Fitted quantities."""
        return self.fit.quantities


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Diagnosis(Shown):
    """All that was found."""

    verdict: Verdict
    candidates: tuple[Candidate, ...]
    """The likeliest first; the record's own law among them."""
    baseline: Candidate
    best: Candidate
    """That of the verdict."""
    posterior: Posterior = field(repr=False)
    noise: NoiseFloor
    board: str
    slides: bool
    record_text: str
    """How the fit differs from the record; '' where it does not."""
    next_experiment: str
    doubts: tuple[str, ...]
    """Doubts about the releases for this board."""
    options: tuple[str, ...]
    """How the command line names the joint."""
    releases: tuple[Release, ...] = field(repr=False)
    recordings: tuple[Recording, ...] = field(default=(), repr=False)

    @property
    def status(self) -> Status:
        """'none-missing', 'missing' or 'unexplained'."""
        return self.verdict.status

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects that `fit` should add; none unless the verdict is 'missing'."""
        return fittable(self.verdict.effects) if self.status == "missing" else ()

    @property
    def logs(self) -> tuple[str, ...]:
        """Logs that were diagnosed."""
        return tuple(dict.fromkeys(release.log for release in self.releases))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Problems of the logs, and doubts about them for this board."""
        return (*reading_warnings(self.recordings), *self.doubts)

    @property
    def is_rate(self) -> bool:
        """Whether rates were fitted, so that errors are rates."""
        return self.baseline.fit.records[0].is_rate

    @property
    def explained(self) -> float:
        """Share by which the best candidate lowers the squared error beyond the noise."""
        floor = self.noise.std**2
        before, after = (max(c.rmse**2 - floor, 0.0) for c in (self.baseline, self.best))
        return float(np.clip(1 - after / before, 0.0, 1.0)) if before > 0 else 0.0

    @property
    def remainder(self) -> float:
        """Error of the best candidate beyond the noise [rad or rad/s]."""
        return float(np.sqrt(max(self.best.rmse**2 - self.noise.std**2, 0.0)))

    def report(self, width: int = WIDTH, space: Workspace | None = None, given: Sequence[Path] = ()) -> str:
        """Return the text that `husky-sysid diagnose` prints.

        Args:
            width: Characters of a line of a table.
            space: Folder of the board; the current one, if left out.
            given: Logs as a command shall name them; those of the releases, if left out.
        """
        return diagnosis_report.report(
            self, width, space or Workspace(Path()), given or tuple(map(Path, self.logs))
        )

    def to_json(self) -> dict[str, Any]:
        """Return the content of `husky-sysid diagnose --json`."""
        return diagnosis_report.to_json(self)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return one row a candidate, the likeliest first: effects, rmse, heldout_rmse [rad or rad/s], score, parameters."""
        import pandas as pd

        columns = ("effects", "rmse", "heldout_rmse", "score")
        return pd.DataFrame(
            {**{name: getattr(c, name) for name in columns}, **{n: q.value for n, q in c.parameters.items()}}
            for c in self.candidates
        )

    def brief(self) -> str:
        """Return the report, or its first lines where it is long."""
        text = self.report()
        return text if len(text) < LONGEST else text[: text.rfind("\n", 0, LONGEST - 2)] + "\n…"


def fittable(names: Sequence[str]) -> tuple[str, ...]:
    """Return those of some effects that `fit` can add: not another number of the record."""
    parts = [effect(name) for name in names]
    return tuple(
        p.name for p in parts if (p.identifiable_from_decay or p.identifiable_with) and p.role != "shift"
    )


def diagnose(
    data: Data,
    board: Board,
    *,
    fixed: Mapping[str, float] | None = None,
    progress: Listener | None = None,
) -> Diagnosis:
    """Name the physical effects that a record is missing.

    Args:
        data: Free decays of one joint: a recording, several, or releases.
        board: The record.
        fixed: Parameters held in every fit, by 'stiffness', 'damping', 'rest_angle' or 'effect.parameter'.
        progress: Called as the work goes on.

    Raises:
        SysidError: Too little motion, or a record without an inertia.
    """
    with listening(progress):
        return _diagnosed(data, board, dict(fixed or {}))


def _diagnosed(data: Data, board: Board, fixed: Mapping[str, float]) -> Diagnosis:
    recordings, releases, weak = unpack(data)
    chosen = signal_of(releases)
    options = FitOptions(fixed=fixed, bounds_friction=False, **chosen)
    own = tuple(part.name for part in board.effects)
    check_parameters(own, options, board)
    noise = noise_floor(releases, rate=chosen["use_rate"])
    with stage(0.0, 0.6, "laws"):
        found = judge(releases, board, noise.std, rate=chosen["use_rate"])
    releases = judged_part(releases, found.motion)
    linear = fit_joint(releases, board, own, options)
    base = Candidate(effects=(), score=0.0, fit=linear, judged=linear.rmse)
    fitted = Fits(releases, board, options, own, base)
    with stage(0.6, 1.0, "fits"):
        fitted.explore(found)
    base = fitted.base
    left = (base.beyond / linear.measured_rms) ** 2
    found, fits = _weighed(found, fitted.all())

    def explained(candidates: Iterable[Candidate]) -> float:
        return 1 - (min(c.beyond for c in candidates) / base.beyond) ** 2 if base.beyond else 1.0

    exact = any(c.reaches_noise for _, c in fits)
    verdict = decide(found, left=left, explained=explained(c for _, c in fits), exact=exact)
    best = fitted.of(verdict.effects, verdict.families)
    verdict = decide(found, left=left, explained=explained([best]), exact=exact)
    best = fitted.of(verdict.effects, verdict.families)
    deviation = record_deviation(best.fit, board, linear=not set(verdict.families) - {"rest"})
    if deviation.effects and verdict.status != "unexplained":
        alike = (*verdict.indistinguishable_from, *((*verdict.effects, *other) for other in deviation.alike))
        effects = (*verdict.effects, *deviation.effects)
        families = (*verdict.families, *(effect(name).family for name in deviation.effects))
        verdict = replace(
            verdict, status="missing", effects=effects, families=families, indistinguishable_from=alike
        )
    once = {best.effects: best, **{c.effects: c for _, c in reversed(fits)}}
    best, ordered = once[best.effects], sorted(once.values(), key=lambda c: c.score)
    rival = next((c for c in ordered if c.effects != best.effects), None)
    step = ""
    if rival is not None and (verdict.indistinguishable_from or verdict.confidence < 0.95):
        names = [" with ".join(c.effects) or "the record's law" for c in (best, rival)]
        step = in_words(deciding(best.fit, rival.fit, board), names[0], names[1], board)
    return Diagnosis(
        verdict=verdict, candidates=tuple(ordered), baseline=base, best=best, posterior=found, noise=noise, board=board.name,
        slides=board.slides, record_text=deviation.text, next_experiment=step,
        doubts=(*weak, *amplitude_warnings(releases, board)), options=tuple(board.options), releases=tuple(releases),
        recordings=recordings,
    )  # fmt: skip


def judge(releases: Sequence[Release], board: Board, noise: float, *, rate: bool) -> Posterior:
    """Return the posterior of sets of laws: by the equations, or by the slow flow where those say less about the damping.

    Equations leave a share ε of the local torque unexplained. A damper takes 2 ζ of it. For ε < 2 ζ the equations see a law of the
    damping. For a larger ε, and enough cycles above the noise, amplitude and phase decide.

    Args:
        releases: Free decays.
        board: The record.
        noise: Noise of a sample [rad or rad/s].
        rate: Whether the rate is judged.
    """
    subject = subject_of(board)
    motion = motion_of(releases, board.rest_angle, noise, rate=rate)
    found = posterior(motion, subject)
    if found.inclusion.get("stop", 0.0) > STOP_LIKELY:
        motion = motion_of(releases, board.rest_angle, noise, rate=rate, nodes=2 * NODES)
        found = posterior(motion, subject, found.grids)
    if found.share <= found.loss:
        return found
    return slow_posterior(found, subject) or found


def subject_of(board: Board) -> Subject:
    """Return the joint of a record: its effects are known, all others are candidates."""
    known: list[tuple[TorqueEffect, Mapping[str, float]]] = []
    for own in board.effects:
        part = effect(own.name)
        if isinstance(part, TorqueEffect) and part.modifies is None and part.changing is None:
            known.append((part, {name: q.value for name, q in own.parameters.items()}))
    hangs = any(part.slope is not None or part.adds_stiffness for part, _ in known)
    return Subject(
        inertia=board.inertia.value, parts=candidates([p.name for p in board.effects]), known=known,
        has_zero=not hangs and not board.is_unmeasured,
    )  # fmt: skip


def _decided(found: Posterior) -> bool:
    """Return whether the equations decide: they explain the log to its noise without torque noise, and are sure of a set."""
    return found.exact and found.sets[0].probability > SURE


def _set(
    families: Sequence[str],
    effects: Sequence[str],
    probability: float = 0.0,
    known: Mapping[str, float] | None = None,
) -> Found:
    """Return a set of laws; those of some known parameters that belong to it are where a fit starts."""
    parameters = {
        name: value
        for name, value in (known or {}).items()
        if "." not in name or name.split(".")[0] in effects
    }
    return Found(
        families=tuple(families), effects=tuple(effects), probability=probability, parameters=parameters
    )


def _parts(best: Found) -> list[Found]:
    """Return a set without each of its laws."""
    pairs = list(zip(best.families, best.effects, strict=True))
    less = [pairs[:i] + pairs[i + 1 :] for i in range(len(pairs))]
    return [_set([f for f, _ in part], [e for _, e in part], known=best.parameters) for part in less if part]


def _variants(best: Found, own: Sequence[str]) -> list[Found]:
    """Return a set with each of its laws replaced by each other one of its family."""
    others = candidates(own)
    return [
        _set(
            best.families,
            (*best.effects[:i], name, *best.effects[i + 1 :]),
            best.probability,
            best.parameters,
        )
        for i, family in enumerate(best.families)
        for name, part in others.items()
        if part.family == family and name != best.effects[i]
    ]


def _weighed(
    found: Posterior, fits: list[tuple[Found, Candidate]]
) -> tuple[Posterior, list[tuple[Found, Candidate]]]:
    """Return the posterior and the fits by output error, where one of these reaches the noise; else as they are.

    Sure equations rule out all other families if they explain the log to its noise without torque noise. A fit also sees the first moments of a release,
    where a hand may act and a sensor's filter lags. Each fit has a rest angle of its own. So the equations alone speak of another rest
    angle. A part of the equations' set still wins if its fit reaches the noise with less.
    """
    decided, likeliest = _decided(found), set(found.sets[0].families)
    rivals = [(one, c) for one, c in fits if not decided or set(one.families) <= likeliest]
    once = {c.effects: (one, c) for one, c in reversed(rivals)}
    if not any(c.reaches_noise for _, c in once.values()):
        return (found if decided else _by_fits(found, fits)), fits
    chances = weigh([(one, c.fit) for one, c in once.values()], [c.judged for _, c in once.values()])
    both = sorted(zip(chances, once.values(), strict=True), key=lambda item: -item[0])
    top, moved = both[0][0], found.inclusion.get("rest", 0.0)
    again: list[tuple[Found, Candidate]] = []
    for chance, (one, candidate) in both:
        pairs = [(f, e) for f, e in zip(one.families, one.effects, strict=True) if f != "rest"]
        pairs += [("rest", "offset")] if moved > EVEN else []
        families, effects = tuple(f for f, _ in pairs), tuple(e for _, e in pairs)
        again.append((
            replace(one, probability=chance * max(moved, 1 - moved), families=families, effects=effects),
            replace(candidate, score=2 * float(np.log(top / max(chance, 1e-300)))),
        ))  # fmt: skip
    inclusion = {
        f: sum(c for c, (one, _) in zip(chances, once.values(), strict=True) if f in one.families)
        for f in found.inclusion
    }
    best = again[0][1]
    sizes = {
        **{f: size for f, size in found.sizes.items() if f == "rest"},
        **sizes_of(best.fit, best.effects),
    }
    exact = best.reaches_noise
    return replace(
        found, sets=tuple(one for one, _ in again), inclusion={**inclusion, **({"rest": moved} if "rest" in inclusion else {})},
        sizes=sizes, nameless=0.0 if exact else found.nameless, share=0.0 if exact else found.share,
    ), again  # fmt: skip


@dataclass(slots=True)
class Fits:
    """Fits of sets of effects to the releases, each made once."""

    releases: Sequence[Release]
    board: Board
    options: FitOptions
    own: tuple[str, ...]
    """Effects of the record."""
    base: Candidate
    """With these alone."""
    made: dict[tuple[str, ...], tuple[Found, Candidate]] = field(default_factory=dict[Any, Any])
    tried: dict[tuple[str, ...], Trial] = field(default_factory=dict[Any, Any])
    """Trials by effects."""
    gain: float = 0.0
    """Of the filter for a walk of the sensor's zero [1]."""

    def all(self) -> list[tuple[Found, Candidate]]:
        """Return all fits with their sets."""
        return list(self.made.values())

    def add(self, one: Found, top: float = 0.0) -> None:
        """Fit a set; one that cannot be fitted, or that ends in impossible torques, is left out.

        Args:
            one: The set.
            top: Probability of the likeliest set.
        """
        names = fittable(one.effects)
        if names in self.made:
            return
        score = 2 * float(np.log(max(top, 1e-300) / max(one.probability, 1e-300)))
        if not names:
            self.made[names] = one, replace(self.base, score=score)
            return
        tried = self.tried.get(names)
        near = {"rest_angle": 0.0, **self._recorded(), **one.parameters} if one.parameters else None
        near = near if tried is None else {**(near or {}), **tried.parameters}
        scales = self.base.fit.problem.scales
        try:
            fit = fit_joint(self.releases, self.board, (*self.own, *names), self.options, scales, near)
            possible = is_possible(fit, names)
        except SysidError:  # no law, or one without bound
            return
        if possible:
            judged = error_beside(fit.residuals, self.gain)
            self.made[names] = one, Candidate(effects=names, score=score, fit=fit, judged=judged)

    def _judge(self) -> None:
        """Judge all fits beside the walk of the sensor's zero that makes the best of them the likeliest."""
        fits = [self.base.fit, *(c.fit for _, c in self.all())]
        self.gain = likeliest_gain(fits)
        self.base = replace(self.base, judged=error_beside(self.base.fit.residuals, self.gain))
        for names, (one, c) in self.made.items():
            self.made[names] = one, replace(c, judged=error_beside(c.fit.residuals, self.gain))

    def of(self, effects: Sequence[str], families: Sequence[str]) -> Candidate:
        """Return the best fit of some families, or that of the record's law if they cannot be fitted."""
        want = set(families) - {"rest"}

        def same() -> list[Candidate]:
            return [c for one, c in self.all() if set(one.families) - {"rest"} == want]

        if not same():
            wider = [c for _, c in self.all() if set(c.effects) >= set(fittable(effects))]
            nearest = min(wider, key=lambda c: c.judged, default=self.base).fit
            self.add(_set(families, effects, known=nearest.problem.parameters(nearest.minimum.point)))
        return min(same(), key=lambda c: c.judged, default=self.base)

    def explore(self, found: Posterior) -> None:
        """Fit the likeliest set, the record's law, and of all that compete with these the best in a trial.

        Parts of the likeliest sets compete. More laws compete if the best set misses the noise and the equations do not decide: others
        of its families, all single laws, and pairs with the best of these. A short motion says more as a whole than its equations do.
        """
        best, top = found.sets[0], found.sets[0].probability
        self.add(best, top)
        self.add(next((s for s in found.sets if not s.families), _set((), ())), top)
        self._judge()
        near = [s for s in found.sets[1:FITTED] if len(set(s.families) - {"rest"}) <= 2]
        rivals = [*near, *(part for s in (best, *near) for part in _parts(s))]
        first = self.made.get(fittable(best.effects))
        if not _decided(found) and found.nameless <= NAMELESS and not (first and first[1].reaches_noise):
            rivals += [*_variants(best, self.own), *self._pairs(found)]
        costs = [(cost, i) for i, one in enumerate(rivals) if (cost := self._trial_cost(one)) is not None]
        for _, i in sorted(costs):
            if len(self.made) < MOST_FITS:
                self.add(rivals[i], top)
        self._judge()

    def _pairs(self, found: Posterior) -> list[Found]:
        """Return all single laws, and pairs of the best one with each other family."""
        plain = [name for name, part in candidates(self.own).items() if len(part.parameters) == 1]
        alone = [*found.singles, *(_set((effect(n).family,), (n,)) for n in plain)]
        costs = sorted((c, i) for i, one in enumerate(alone) if (c := self._trial_cost(one)) is not None)
        ranked = [alone[i] for _, i in costs]
        pairs: dict[str, Found] = {}
        for one in ranked[1:]:
            families, effects = ranked[0].families + one.families, ranked[0].effects + one.effects
            if one.families != ranked[0].families and one.families[0] not in pairs:
                known = {
                    **self.tried[fittable(one.effects)].parameters, **self.tried[fittable(ranked[0].effects)].parameters
                }  # fmt: skip
                pairs[one.families[0]] = _set(families, effects, known=known)
        return [*alone, *pairs.values()]

    def _trial_cost(self, one: Found) -> float | None:
        """Return the cost of a set in a trial from its parameters, or None if nothing of it can be fitted."""
        names = fittable(one.effects)
        if names and names not in self.tried:
            start = {"rest_angle": 0.0, **self._recorded(), **one.parameters}
            try:
                self.tried[names] = trial_fit(
                    self.base.fit, self.board, (*self.own, *names), self.options, start
                )
            except SysidError:
                return None
        if not names:
            return None
        noise = self.base.fit.noise
        return _cost(names, error_beside(self.tried[names].residuals, self.gain) / noise.std, noise)

    def _recorded(self) -> dict[str, float]:
        """Return the parameters of the record's effects by 'effect.parameter'."""
        return {
            f"{part.name}.{n}": q.value for part in self.board.effects for n, q in part.parameters.items()
        }


def _cost(names: Sequence[str], error: float, noise: NoiseFloor) -> float:
    """Return the log error beyond the noise, and what the parameters of some effects have to be worth.

    Args:
        names: The effects.
        error: RMSE of their fit over the noise [1].
        noise: The noise: what its interval leaves open is no error.
    """
    count = sum(len(effect(name).parameters) for name in names)
    open_still = max((noise.highest / noise.std) ** 2 - 1, float(np.finfo(float).tiny))
    return 0.5 * float(np.log(max(error**2 - 1, open_still))) - count * float(np.log(1 - BENDS))


def _by_fits(found: Posterior, fits: list[tuple[Found, Candidate]]) -> Posterior:
    """Return the posterior with that set first whose fit explains most for its number of parameters.

    No law of the catalogue is exact here, and a second one may only bend the first. So each parameter has to lower the error beyond the
    noise by a share `BENDS`.
    """
    best = found.sets[0]
    one, candidate = min(fits, key=lambda item: item[1].cost)
    if set(one.families) - {"rest"} == set(best.families) - {"rest"}:
        return found
    rest = tuple(s for s in found.sets if s.families != one.families)
    chance = max(one.probability, best.probability)
    sizes = {**found.sizes, **sizes_of(candidate.fit, candidate.effects)}
    return replace(found, sets=(replace(one, probability=chance), *rest), sizes=sizes)


__all__ = ["Candidate", "Diagnosis", "Hint", "Verdict", "diagnose", "fittable", "judge"]
