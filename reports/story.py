"""The story of a joint as data: the decay and its law, the missing torque, the errors of the models, the candidates.

Two laws are compared with the releases: the record as it stood, and the law with the missing effects. `reports.figures.story`
draws the result.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np

from reports.evidence import Evidence, LastDiagnosis
from sysid.board import Board
from sysid.comparison.compare import Comparison, compare
from sysid.diagnosis.demand import TorqueProfile, demand_of
from sysid.diagnosis.report import TIE as TIED
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.fitting.ladder import PLAIN
from sysid.joint import JointLaw
from sysid.joint.structure import structure_of
from sysid.joint.torques import effect_torque
from sysid.noise.whiteness import autocorrelation
from sysid.recording import Data, unpack
from sysid.roll import Array, Release
from sysid.shown import MOST_SHOWN

if TYPE_CHECKING:
    from sysid.diagnosis.diagnose import Diagnosis

STOOD = "as it stood"
REFITTED = "k and d refitted"
RECORD = "the record"
"""A law that was fitted to other logs."""
MOST_NAMED = 2
"""Most effects named in a label."""
MOST_POINTS = 150
"""Most points of an autocorrelation or of a law that are drawn."""


@dataclass(frozen=True, slots=True)
class Step:
    """One model of the ladder."""

    label: str
    error: float
    """RMS error on the releases that were looked at, in multiples of the noise."""
    heldout: float | None = None
    """On releases that were left out, in multiples of the noise."""


@dataclass(frozen=True, slots=True)
class Ranked:
    """One candidate of a diagnosis."""

    effects: tuple[str, ...]
    """Beyond the record's own."""
    score: float
    """Twice the log evidence that the best has more."""
    chosen: bool

    @property
    def label(self) -> str:
        """Its effects, for people."""
        return " + ".join(self.effects) or "nothing"


@dataclass(frozen=True, slots=True)
class Missing:
    """The torque beyond spring and damper against tilt or rate, and that of the effects."""

    seen: TorqueProfile
    at: Array
    """Tilt [rad] or rate [rad/s] of the drawn law, shape (m,); empty without a named effect."""
    law: Array
    """Mean torque of the effects there [N*m], shape (m,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Story:
    """Data of the four panels."""

    board: str
    effects: tuple[str, ...]
    """Effects that the law after has beyond the record, or beyond spring and damper."""
    labels: tuple[str, str]
    """Of the law before and after."""
    before: Comparison | None
    """None if there was no other law, or its motion grows without bound."""
    after: Comparison
    shown: int
    """Which release is drawn: the one that the law before misses most."""
    over_rate: Missing | None
    """None where the sampling is too slow."""
    over_angle: Missing | None
    steps: tuple[Step, ...]
    ranked: tuple[Ranked, ...]
    """Best first; empty without a diagnosis."""
    lags: Array
    """[s], shape (l,), from the first on."""
    correlations: tuple[tuple[str, Array], ...]
    """Autocorrelation of the residual of each law, shape (l,)."""
    white: float
    """Half width of the 99 % band in which it lies if the residual is white."""

    @property
    def release(self) -> str:
        """Name of the drawn release."""
        return release_name(self.after, self.shown)

    @property
    def noise_range(self) -> tuple[float, float]:
        """95 % interval of the noise floor, in multiples of it."""
        noise = self.after.noise
        return noise.lowest / noise.std, noise.highest / noise.std

    @property
    def fall(self) -> tuple[float, float]:
        """Error before and after, in multiples of the noise; NaN before where the law ran away."""
        floor = self.after.noise.std
        return (np.nan if self.before is None else self.before.rmse / floor), self.after.rmse / floor

    @property
    def why(self) -> str:
        """Why the chosen candidate was chosen, in words."""
        chosen = next((model for model in self.ranked if model.chosen), None)
        if chosen is None:
            return ""
        if chosen.score == 0:
            return "the best"
        if chosen.score <= TIED:
            return "the simplest that ties with the best"
        return "the simplest of several" if chosen.effects else "nothing more is sure, or matters"


def times(error: float) -> str:
    """Return an error in multiples of the noise with three digits, never with an exponent."""
    return f"{error:.3g}" if error < 1000 else f"{error:.0f}"


def release_name(result: Comparison, index: int) -> str:
    """Return the name of a release; with its log if there are several logs."""
    release = result.releases[index]
    several = len({other.log for other in result.releases}) > 1
    return f"{Path(release.log).name}, release {release.number}" if several else f"release {release.number}"


def tell(
    data: Data,
    board: Board,
    *,
    laws: tuple[JointLaw, JointLaw],
    effects: Sequence[str],
    steps: Sequence[Step] = (),
    heldout: float | None = None,
    label: str = "",
) -> Story:
    """Compare two laws of a board with recordings, and describe their difference.

    Args:
        laws: The law before, and the law after.
        effects: Effects that the law after has beyond the law before.
        steps: The ladder between the two laws.
        heldout: Error of the law after on releases that were left out, in multiples of the noise.
        label: Of the law after, where its effects do not say it.

    Raises:
        SysidError: The law after cannot be compared with these releases.
    """
    before, after = laws
    latter = compare(data, board, law=after)
    try:
        former = None if before == after else compare(data, board, law=before)
    except SysidError:
        former = None
    floor = latter.noise.std
    worst = latter if former is None else former
    over_rate, over_angle = _missing(unpack(data)[1], latter, effects)
    label = label or _added(tuple(effects))
    lags, correlations = _correlations([*([] if former is None else [(STOOD, former)]), (label, latter)])
    stood = [] if former is None else [Step(STOOD, former.rmse / floor)]
    own = Step(label, latter.rmse / floor, heldout)  # of logs that it was not fitted to, before the refits
    return Story(
        board=board.name,
        effects=tuple(effects),
        labels=(STOOD, label),
        before=former,
        after=latter,
        shown=int(np.argmax([release.rmse for release in worst.releases])),
        over_rate=over_rate,
        over_angle=over_angle,
        steps=(*stood, own, *steps) if label in (STOOD, RECORD) else (*stood, *steps, own),
        ranked=(),
        lags=lags,
        correlations=correlations,
        white=NormalDist().inv_cdf(0.995) / float(np.sqrt(sum(len(r.residual) for r in latter.releases))),
    )


def _correlations(
    laws: Sequence[tuple[str, Comparison]],
) -> tuple[Array, tuple[tuple[str, Array], ...]]:
    """Return lags [s] up to a period of the last law, and the autocorrelation of each law's residuals."""
    last = laws[-1][1]
    step = float(np.median(np.diff(last.releases[0].time)))
    period = int(2 * np.pi / last.law.frequency / step)  # in samples
    longest = max(2, min(min(len(r.residual) for r in last.releases) // 2, period))
    lags = np.unique(np.linspace(1, longest, min(longest, MOST_POINTS)).astype(int))
    residuals = [(name, [release.residual for release in law.releases]) for name, law in laws]
    return lags * step, tuple((name, autocorrelation(each, longest)[lags]) for name, each in residuals)


def _missing(
    releases: Sequence[Release], after: Comparison, effects: Sequence[str]
) -> tuple[Missing | None, Missing | None]:
    """Return the torque that the motion demands beside spring and damper, and that of some effects, over rate and over angle."""
    law = after.law
    torques = [part.name for part in law.structure.torques]  # the known weight of a model among them
    named = tuple(name for name in torques if name in effects)
    others = [name for name in torques if name not in named]
    try:
        demand = demand_of(releases, law, after.noise.std, rate=after.is_rate, beside=others)
    except SysidError:
        return None, None
    angle = np.concatenate([r.roll for r in after.releases]) - law.rest_angle
    rate = np.concatenate([r.rate for r in after.releases])
    each = [[effect_torque(law, name, r.time, r.roll, r.rate) for r in after.releases] for name in named]
    torque = np.sum([np.concatenate(parts) for parts in each], axis=0) if named else None
    over_rate = Missing(demand.over(demand.rate), *_averaged(rate, torque))
    return over_rate, Missing(demand.over(demand.angle), *_averaged(angle, torque))


def _averaged(at: Array, torque: Array | None) -> tuple[Array, Array]:
    """Average a torque over bins of equal count; empty without a named effect."""
    if torque is None or np.isnan(torque).any():
        return np.zeros(0), np.zeros(0)
    parts = np.array_split(np.argsort(at), min(MOST_POINTS, len(at)))
    return np.array([at[p].mean() for p in parts]), np.array([torque[p].mean() for p in parts])


def story_of_diagnosis(found: "Diagnosis", board: Board) -> Story:
    """Return the story of a diagnosis with its recordings: the record as it stood, and with the missing effects."""
    floor = found.noise.std
    chosen = found.best.effects
    tried = {candidate.effects: candidate for candidate in (*found.candidates, found.baseline)}
    halves = [(name,) for name in chosen if len(chosen) > 1 and (name,) in tried]
    between = [(), *([min(halves, key=lambda names: tried[names].score)] if halves else [])] if chosen else []
    held = {names: c.heldout_rmse / floor for names, c in tried.items()}
    story = tell(
        found.recordings or found.releases,
        board,
        laws=(JointLaw.from_board(board), found.best.fit.law),
        effects=chosen,
        steps=[Step(_added(names), tried[names].rmse / floor, held[names]) for names in between],
        heldout=held.get(chosen),
    )
    return replace(story, ranked=ranked([(c.effects, c.score) for c in found.candidates], chosen))


def for_report(found: "Diagnosis", board: Board) -> dict[str, Any]:
    """Return the data of a diagnosis for a report besides its JSON: its record, and the model behind its verdict."""
    law = found.best.fit.law
    values = zip(law.structure.parameters, law.vector, strict=True)
    parameters = {name: {"value": float(value)} for name, value in values}
    return {"record": board.digest, "best": {"effects": list(found.best.effects), "parameters": parameters}}


def story_of_board(evidence: Evidence, diagnosis: LastDiagnosis | None) -> Story:
    """Return the story of a record: before its fits, and now or with the effects of its last diagnosis."""
    board, floor, after = evidence.board, evidence.comparison.noise.std, evidence.comparison.law
    effects = tuple(part.name for part in board.effects if not effect(part.name).is_known)
    steps = [
        Step(
            REFITTED if rung.label == PLAIN and not evidence.stood.effects else rung.label, rung.rmse / floor,
            rung.heldout_rmse / floor if np.isfinite(rung.heldout_rmse) else None,
        )
        for rung in evidence.ladder
    ]  # fmt: skip
    is_fit = bool(board.fit) and all(file.state == "as fitted" for file in evidence.files)
    last = steps.pop() if evidence.fit is not None and is_fit else None
    heldout = None if last is None else last.heldout
    label = "" if is_fit else STOOD if evidence.stood == after else RECORD
    models: tuple[Ranked, ...] = ()
    if diagnosis is not None:
        content = diagnosis.content
        chosen = tuple(content["best"]["effects"])
        models = ranked([(c["effects"], c["score"]) for c in content["candidates"]], chosen)
        law = law_of_candidate(board, content["best"])
        if chosen and diagnosis.is_current and law is not None:
            if last is not None:
                steps.append(replace(last, label=_added(effects)))
            after, effects, label = law, (*effects, *chosen), ""
            held = next(
                (c["heldout_rmse_rad"] for c in content["candidates"] if tuple(c["effects"]) == chosen), None
            )
            heldout = None if held is None else held / content["noise_floor_rad"]
    story = tell(
        evidence.releases, board, laws=(evidence.stood, after), effects=effects, steps=steps, heldout=heldout, label=label,
    )  # fmt: skip
    return replace(story, ranked=models)


def _added(effects: tuple[str, ...]) -> str:
    if len(effects) > MOST_NAMED:
        return f"with all {len(effects)} effects"
    return f"with {' and '.join(effects)}" if effects else REFITTED


def ranked(
    candidates: Sequence[tuple[Sequence[str], float | None]], chosen: Sequence[str]
) -> tuple[Ranked, ...]:
    """Return the candidates to draw, best first: the best, the record's own law and the chosen one among them.

    Each has effects and score.
    """
    known = [(tuple(names), score) for names, score in candidates if score is not None and np.isfinite(score)]
    models = [Ranked(names, score, names == tuple(chosen)) for names, score in known]
    return (*models[:MOST_SHOWN], *(one for one in models[MOST_SHOWN:] if one.chosen or not one.effects))


def law_of_candidate(board: Board, candidate: Mapping[str, Any]) -> JointLaw | None:
    """Return the law of a candidate in diagnose.json; None where numbers of it were held that the file does not have."""
    structure = structure_of([*(part.name for part in board.effects), *candidate["effects"]])
    known = {name: quantity["value"] for name, quantity in candidate["parameters"].items()}
    # A joint that hangs has no spring, and no rest angle beside the sensor's zero.
    hangs = "stiffness" not in known
    rest = 0.0 if hangs else board.rest_angle
    values = {"inertia": board.inertia.value, "stiffness": 0.0, "rest_angle": rest, **known}
    if not set(structure.parameters) <= set(values):
        return None
    return JointLaw.from_vector(structure, np.array([values[name] for name in structure.parameters]))
