"""Simulated against measured decay: how far off, where, and which torque the model lacks.

The board's law is taken as recorded; only what no record can know is fitted: roll and rate at each
release, because one noisy sample must not decide the comparison.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.backbone import Backbone, backbone
from sysid.board import Board
from sysid.error_places import Place, error_places
from sysid.errors import HuskyError
from sysid.fit_mjcf import scales_of
from sysid.fit_problem import Problem, Record, make_records
from sysid.joint import JointLaw, simulate
from sysid.least_squares import minimise
from sysid.missing_torque import TorqueMap, missing_torque, torque_map
from sysid.noise import NoiseFloor, noise_floor
from sysid.roll import Array, Release

TOLERANCE = 0.02
"""Error beyond the noise, over the RMS of the measured roll about rest, that is accepted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReleaseComparison:
    """One release: what was measured and what the law makes of the same start."""

    release: Release
    time: Array
    """Since the release [s], shape (n,); up to the end of the motion, and somewhat of the rest after it."""
    measured: Array
    """Roll [rad], shape (n,)."""
    simulated: Array
    """Roll [rad], shape (n,)."""
    rate: Array
    """Simulated roll rate [rad/s], shape (n,)."""
    torque: Array
    """Torque that the law lacks along the motion [N*m], shape (n,)."""
    rest: float
    """The law's rest angle, with the sensor's zero [rad]."""

    @property
    def residual(self) -> Array:
        """Measured less simulated [rad], shape (n,)."""
        return self.measured - self.simulated

    @property
    def rmse(self) -> float:
        """Root mean square residual [rad]."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def nrmse(self) -> float:
        """RMSE over the RMS of the measured roll about rest."""
        return self.rmse / float(np.sqrt(np.mean((self.measured - self.rest) ** 2)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """All releases of some logs beside one board."""

    board: Board
    law: JointLaw
    releases: tuple[ReleaseComparison, ...]
    noise: NoiseFloor
    tolerance: float
    places: tuple[Place, ...]
    """Where the error beyond the noise sits; empty where there is none."""
    torque: TorqueMap
    """The torque that the law lacks, over angle and rate."""
    measured_backbone: Backbone
    simulated_backbone: Backbone

    @property
    def rmse(self) -> float:
        """Root mean square residual over all samples [rad]."""
        return float(np.sqrt(np.mean(np.concatenate([r.residual for r in self.releases]) ** 2)))

    @property
    def measured_rms(self) -> float:
        """RMS of the measured roll about rest over all samples [rad]."""
        return float(np.sqrt(np.mean(np.concatenate([r.measured - r.rest for r in self.releases]) ** 2)))

    @property
    def nrmse(self) -> float:
        """RMSE over the RMS of the measured roll about rest."""
        return self.rmse / self.measured_rms

    @property
    def excess(self) -> float:
        """The part of `nrmse` that is not sensor noise."""
        return float(np.sqrt(max(self.rmse**2 - self.noise.std**2, 0.0))) / self.measured_rms

    @property
    def passed(self) -> bool:
        """Whether the error beyond the noise is within the tolerance."""
        return self.excess <= self.tolerance


def compare(releases: Sequence[Release], board: Board, *, tolerance: float = TOLERANCE) -> Comparison:
    """Release the board's law as each measured release was, and compare.

    Args:
        releases: Free decays of the board.
        board: Its record, effects included.
        tolerance: Accepted error beyond the noise, over the RMS of the measured roll about rest.

    Raises:
        HuskyError: There is no release, or the law has no bounded motion.
    """
    if not releases:
        raise HuskyError("no release to compare. Let the deck go and record until it rests.")
    noise = noise_floor(releases)
    records = make_records(releases, noise.std, rate=False)
    law = JointLaw.from_board(board)
    compared = tuple(_compare(record, board, law) for record in records)
    lacking = max(float(np.sqrt(np.mean(c.residual**2))) for c in compared) > 1.1 * noise.std
    return Comparison(
        board=board,
        law=law,
        releases=compared,
        noise=noise,
        tolerance=tolerance,
        places=error_places(compared, noise.std) if lacking else (),
        torque=torque_map(compared),
        measured_backbone=backbone([(c.time, c.measured, c.rest) for c in compared], noise.std),
        simulated_backbone=backbone([(c.time, c.simulated, c.rest) for c in compared], noise.std),
    )


def _compare(record: Record, board: Board, law: JointLaw) -> ReleaseComparison:
    """Fit the start of one release and let the law run from there."""
    names, vector = law.structure.parameters, law.vector
    fixed = {name: float(value) for name, value in zip(names[1:], vector[1:], strict=True)}
    # The zero of an integrated gyro is arbitrary: it is the log's, not the board's.
    own_zero = record.release.origin == "gyro"
    problem = Problem(
        law.structure,
        [record],
        scales_of([record], board),
        bias="own" if own_zero else "shared",
        fixed=fixed,
        free_states=False,
        steps_per_period=120,
    )
    minimum = minimise(problem.normal, problem.start(fixed), *problem.bounds(), iterations=30)
    unknowns = minimum.point * problem.sizes()
    zero = float(unknowns[-1]) if own_zero else 0.0
    path = simulate(
        law, record.time, float(unknowns[0]), float(unknowns[1]), hold=max(record.release.hold, 0.0)
    )
    simulated = path.roll + zero
    return ReleaseComparison(
        release=record.release,
        time=record.time,
        measured=record.signal,
        simulated=simulated,
        rate=path.rate,
        torque=missing_torque(record.time, record.signal - simulated, law),
        rest=law.rest_angle + zero,
    )
