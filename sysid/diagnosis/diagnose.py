"""Which effect is missing: evidence for sets of laws, then fits of the likeliest ones.

The posterior (`posterior`, `slow_flow`) names families with probabilities. The likeliest sets are then fitted by output error, by the
code of `fit`: those fits give errors, held-out errors, and parameters with intervals.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.board import Board
from sysid.decay.plausibility import amplitude_warnings
from sysid.diagnosis import report as diagnosis_report
from sysid.diagnosis.experiment import deciding, in_words
from sysid.diagnosis.fits import Candidate, Fits, by_fits, fittable, sizes_of
from sysid.diagnosis.laws import candidates
from sysid.diagnosis.motion import judged_part, motion_of
from sysid.diagnosis.posterior import Posterior, Subject, posterior
from sysid.diagnosis.record import record_deviation
from sysid.diagnosis.slow_flow import slow_posterior
from sysid.diagnosis.verdict import Hint, Status, Verdict, decide
from sysid.effects import effect
from sysid.effects._base import TorqueEffect
from sysid.fitting.joint import FitOptions, check_parameters, fit_joint
from sysid.fitting.records import signal_of
from sysid.noise.floor import NoiseFloor, noise_floor
from sysid.progress import Listener, listening, stage
from sysid.recording import Data, Recording, reading_warnings, unpack
from sysid.roll import Release
from sysid.shown import Shown
from sysid.text import WIDTH
from sysid.workspace import Workspace

if TYPE_CHECKING:
    import pandas as pd

LONGEST = 2000
"""Characters of a diagnosis as an interpreter shows it."""


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
        judged = judge(releases, board, noise.std, rate=chosen["use_rate"])
    releases = judged_part(releases, judged.motion)
    linear = fit_joint(releases, board, own, options)
    fits = Fits(releases, board, options, Candidate(effects=(), fit=linear))
    with stage(0.6, 1.0, "fits"):
        fits.explore(judged)
    found = by_fits(judged, fits.rivals(judged))
    likeliest = fits.of(found.sets[0].effects)
    found = replace(found, sizes=sizes_of(likeliest, board.rest_angle))
    verdict = decide(found, likeliest, fits.base)
    named = fits.of(verdict.effects).effects
    ordered = fits.rivals(judged)
    best = next(c for c in ordered if c.effects == named)
    deviation = record_deviation(best.fit, board, linear=not set(verdict.families) - {"rest"})
    if deviation.effects and verdict.status != "unexplained":
        alike = (*verdict.indistinguishable_from, *((*verdict.effects, *other) for other in deviation.alike))
        effects = (*verdict.effects, *deviation.effects)
        families = (*verdict.families, *(effect(name).family for name in deviation.effects))
        verdict = replace(
            verdict, status="missing", effects=effects, families=families, indistinguishable_from=alike
        )
    rival = next((c for c in ordered if c is not best), None)
    step = ""
    if rival is not None and (verdict.indistinguishable_from or verdict.confidence < 0.95):
        names = [" with ".join(c.effects) or "the record's law" for c in (best, rival)]
        step = in_words(deciding(best.fit, rival.fit, board), names[0], names[1], board)
    return Diagnosis(
        verdict=verdict, candidates=tuple(ordered), baseline=fits.base, best=best, posterior=found, noise=noise, board=board.name,
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


__all__ = ["Candidate", "Diagnosis", "Hint", "Verdict", "diagnose", "fittable", "judge"]
