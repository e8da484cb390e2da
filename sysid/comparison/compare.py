"""Comparison of measured and simulated decays: the error, its location, and the missing torque.

Only roll and rate at each release are fitted here; the law is that of the board's record.
"""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from sysid.board import Board, require_record
from sysid.comparison import report as comparison_report
from sysid.comparison.backbone import Backbone, backbone_of
from sysid.comparison.error_map import Place, describe_error, locate_error
from sysid.comparison.release import ComparedRelease
from sysid.decay.plausibility import amplitude_warnings
from sysid.diagnosis.demand import Demand, demand_of
from sysid.errors import SysidError
from sysid.files import sha256
from sysid.fitting.cross_validation import rms
from sysid.fitting.initial_state import fit_initial_states
from sysid.fitting.joint import FitOptions, held_parameters
from sysid.fitting.records import Record, make_records, signal_of
from sysid.fitting.result import TOLERANCE, motion_rms
from sysid.joint import JointLaw, simulate
from sysid.noise.floor import NoiseFloor, noise_floor
from sysid.progress import stage
from sysid.quantity import Z95
from sysid.recording import Data, Recording, reading_warnings, unpack
from sysid.roll import Array
from sysid.shown import Shown
from sysid.text import WIDTH, Display, count, display

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, repr=False)
class Comparison(Shown):
    """Result of `compare`: the difference of simulated and measured releases, and its location."""

    board: str
    law: JointLaw
    releases: tuple[ComparedRelease, ...]
    rmse: float
    nrmse: float
    """RMSE over the RMS of the measurement about rest."""
    excess: float
    """`nrmse` without the noise: the model's own error."""
    excess_range: tuple[float, float]
    """95 % interval of `excess`: the noise floor itself is estimated from few samples."""
    noise: NoiseFloor
    where: tuple[Place, ...]
    """Largest share first."""
    summary: str
    """In words."""
    measured_backbone: Backbone
    simulated_backbone: Backbone
    tolerance: float
    is_rate: bool
    slides: bool = False
    """Whether the joint is a slide, whose positions are in m."""
    heldout_rmse: float | None = None
    """Error on releases that the fit did not see: `rmse`, or the fit's own held-out error if it used a log given here. None if
    unknown."""
    warnings: tuple[str, ...] = ()
    """Problems of the logs, and of the logs for this board."""
    recordings: tuple[Recording, ...] = ()
    """The logs; empty if only releases were given."""

    @cached_property
    def missing(self) -> Demand | None:
        """The torque that the measured motion demands beyond the simulated one; None if too little motion is above the noise.

        Effects with memory act alike in both motions, and so does the smoothing.
        """
        beside = [part.name for part in self.law.structure.parts if not part.states]
        demand = partial(demand_of, law=self.law, noise=self.noise.std, rate=self.is_rate, beside=beside)
        try:
            measured = demand([one.release for one in self.releases])
            return measured.less(demand([one.as_simulated() for one in self.releases], like=measured))
        except SysidError:
            return None

    @property
    def show(self) -> Display:
        """Display of the measured signal."""
        return display(is_rate=self.is_rate, slides=self.slides)

    @property
    def passed(self) -> bool:
        """Whether the lower end of the error beyond the noise is within the tolerance."""
        return self.excess_range[0] <= self.tolerance

    @property
    def status(self) -> str:
        """'within tolerance' or 'beyond tolerance'."""
        return "within tolerance" if self.passed else "beyond tolerance"

    def brief(self) -> str:
        """Return the error, its location, and whether it is within the tolerance."""
        error = f"error {self.show(self.rmse)}, {self.rmse / self.noise.std:.3g} times the noise"
        return f"Comparison of {self.board} with {count(len(self.releases), 'release')}: {error}\n  {self.summary}\n  {self.status}: {self.verdict()}"

    def report(self, width: int = WIDTH) -> str:
        """Return the text of `husky-sysid compare`, in tables of at most `width` characters."""
        return comparison_report.report(self, width)

    def to_json(self) -> dict[str, Any]:
        """Return the result of `husky-sysid compare --json`."""
        return comparison_report.to_json(self)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return one row a release: log, number, rmse [rad, or rad/s if the rate was compared], error / noise."""
        import pandas as pd

        rows = [(r.log, r.number, r.rmse, r.rmse / self.noise.std) for r in self.releases]
        return pd.DataFrame(rows, columns=pd.Index(["log", "release", "rmse", "error_over_noise"]))

    def verdict(self) -> str:
        """Return a sentence: the error beyond the noise, its interval if wide, and the tolerance."""
        low, high = self.excess_range
        allowed = f"{100 * self.tolerance:.2f} % allowed"
        if high - low < 0.1 * self.tolerance:
            return f"{100 * self.excess:.2f} % beyond the noise, {allowed}"
        return (
            f"{100 * self.excess:.2f} % ({100 * low:.2f} to {100 * high:.2f} %) beyond the noise (the noise is known to "
            f"±{100 * Z95 * self.noise.relative_std:.0f} %); {allowed}"
        )


def compare(
    data: Data,
    board: Board,
    *,
    law: JointLaw | None = None,
    tolerance: float = TOLERANCE,
) -> Comparison:
    """Simulate each release with a board's law and compare.

    Args:
        data: Measured decays: a recording, several, or releases.
        law: Another law than the record's.
        tolerance: Largest error beyond the noise, over the RMS motion, of a comparison that passes.

    Raises:
        SysidError: The law's motion grows without bound.
    """
    recordings, releases, weak = unpack(data)
    require_record(board)
    chosen = signal_of(releases)
    odd = amplitude_warnings(releases, board)
    law = law or JointLaw.from_board(board)
    if law.stiffness + law.stiffness_of_effects <= 0:
        odd += _require_restoring(board)
    noise = noise_floor(releases, rate=chosen["use_rate"])
    records = make_records(releases, noise.std, rate=chosen["use_rate"])
    _, bias = held_parameters(law.structure, board, FitOptions(**chosen))
    with stage(0.0, 1.0):
        residuals, starts = fit_initial_states(law, records, bias=bias)
    compared = tuple(map(partial(_compared, law), records, residuals, starts))
    rmse = rms(residuals)
    size = motion_rms(law, records, bias)
    least, excess, most = (part / size for part in noise.excess(rmse))
    where = locate_error(compared, law, noise, board)
    return Comparison(
        board=board.name,
        law=law,
        releases=compared,
        rmse=rmse,
        nrmse=rmse / size,
        excess=excess,
        excess_range=(least, most),
        noise=noise,
        where=where,
        summary=describe_error(where, rmse, noise.std),
        measured_backbone=backbone_of(compared, law, [c.measured for c in compared], noise.std),
        simulated_backbone=backbone_of(compared, law, [c.simulated for c in compared], 0.0),
        tolerance=tolerance,
        is_rate=chosen["use_rate"],
        slides=board.slides,
        heldout_rmse=_heldout(board, recordings, rmse),
        warnings=(*reading_warnings(recordings), *weak, *odd),
        recordings=recordings,
    )


def _require_restoring(board: Board) -> list[str]:
    """Return a warning of a fitted joint without restoring torque.

    Raises:
        SysidError: The record was never fitted, so that a comparison is meaningless.
    """
    if board.fit or not board.is_unmeasured:
        return [f"nothing pulls the joint of '{board.name}' back to rest: its law is friction alone"]
    if board.model:
        raise SysidError(
            f"nothing pulls the joint '{board.model['joint']}' back to rest in this pose of {board.model['file']}. Is it the pose "
            "of the measurement? Give it with --pose JOINT=VALUE or --keyframe. If only friction holds the joint, fit it "
            "first: husky-sysid fit."
        )
    raise SysidError(
        f"the record of '{board.name}' has no stiffness and no damping: it was never fitted. Fit it first: husky-sysid fit LOG "
        f"{' '.join(board.options)}"
    )


def _heldout(board: Board, recordings: tuple[Recording, ...], rmse: float) -> float | None:
    fitted = {entry.get("sha256") for entry in board.fit.get("logs", [])}
    files = [recording.path for recording in recordings if fitted and recording.path.is_file()]
    return board.fit.get("heldout_rmse") if any(sha256(file) in fitted for file in files) else rmse


def _compared(law: JointLaw, record: Record, residual: Array, start: tuple[float, float]) -> ComparedRelease:
    known = record.release.known
    path = simulate(
        law.posed(known), record.time, *start, hold=max(record.release.hold, 0.0), begin=record.release.start
    )
    return ComparedRelease(record=record, simulated=record.signal + residual, roll=path.roll, rate=path.rate)
