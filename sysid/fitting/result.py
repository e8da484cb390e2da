"""A fitted joint: its law, its parameters with their uncertainty, and what is left."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.board import Board
from sysid.fitting.changing import changes_with_time
from sysid.fitting.covariance import (
    common_covariance,
    correlation_of,
    identifiability_warnings,
    parameter_covariance,
    parameter_quantities,
)
from sysid.fitting.cross_validation import heldout_residuals, rms
from sysid.fitting.problem import Problem
from sysid.fitting.records import Record, read_at_rest
from sysid.joint.law import JointLaw
from sysid.joint.torques import torque_shares
from sysid.least_squares import Minimum
from sysid.noise.floor import NoiseFloor
from sysid.noise.whiteness import correlation_length
from sysid.quantity import Quantity
from sysid.roll import Array

TOLERANCE = 0.02
"""Error beyond the noise, over the RMS of the motion, up to which a law passes for the measured one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFit:
    """A fitted joint, with what is known of its uncertainty."""

    law: JointLaw
    quantities: Mapping[str, Quantity]
    """'stiffness', 'damping', 'rest_angle' and 'effect.parameter', with the uncertainty of the inertia and of the sensor's scale in them."""
    covariance: Array
    """Of `quantities`, in their order, shape (q, q)."""
    own_covariance: Array
    """The same for an inertia and a scale of the sensor that are known: what these logs leave open."""
    rmse: float
    """Root mean square residual over all samples [rad; rad/s if the rate was fitted]."""
    noise: NoiseFloor
    records: tuple[Record, ...]
    starts: tuple[tuple[float, float], ...]
    """Roll [rad] and rate [rad/s] at each release."""
    residuals: tuple[Array, ...]
    """Model minus measurement of each record."""
    evaluations: int
    warnings: tuple[str, ...] = ()
    problem: Problem = field(repr=False)
    minimum: Minimum = field(repr=False)

    @property
    def correlation(self) -> Array:
        """Correlation of the quantities, shape (q, q) [1]."""
        return correlation_of(self.covariance)

    @property
    def status(self) -> str:
        """Termination of the search, in words."""
        return f"{self.minimum.status} after {self.evaluations} evaluations"

    @property
    def nonsmooth(self) -> bool:
        """Whether the cost has kinks, which an interval from the Jacobian does not see."""
        structure = self.law.structure
        return structure.has_dry_friction or structure.nonsmooth

    @property
    def measured_rms(self) -> float:
        """RMS of the measured signal about rest, of all records together."""
        total, count = 0.0, 0
        for record in self.records:
            rest = read_at_rest(record, self.law.posed(record.release.known).rest_angle, self.problem.bias)
            total += float(np.sum((record.signal - rest) ** 2))
            count += len(record.signal)
        return float(np.sqrt(total / count))

    def heldout_rmse(self) -> float:
        """Return the error on releases that were left out, one after another [rad or rad/s].

        With one release it is the second half of its motion, predicted from the first.
        """
        return rms(heldout_residuals(self.problem, self.minimum))

    @property
    def nrmse(self) -> float:
        """RMSE over the RMS of the measurement about rest."""
        return self.rmse / self.measured_rms

    @property
    def excess(self) -> float:
        """Error that is surely more than noise, over the RMS of the measurement about rest."""
        return self.noise.excess(self.rmse)[0] / self.measured_rms


def summarise(
    problem: Problem, minimum: Minimum, board: Board, noise: NoiseFloor, evaluations: int
) -> JointFit:
    """Turn a minimum into quantities with uncertainty."""
    residuals = problem.residuals(minimum.point)
    parameters = problem.parameters(minimum.point)
    own = parameter_covariance(problem, minimum, residuals)
    covariance = own + common_covariance(problem, minimum, board)
    quantities = parameter_quantities(problem, minimum, board, covariance)
    vector = problem.vector_of(parameters)
    squares = sum(float(r @ r) for r in residuals)
    return JointFit(
        law=JointLaw.from_vector(problem.structure, vector),
        quantities=quantities,
        covariance=covariance,
        own_covariance=own,
        rmse=float(np.sqrt(squares / problem.samples)),
        noise=noise,
        records=tuple(problem.records),
        starts=tuple(problem.starts(minimum.point)),
        residuals=tuple(residuals),
        evaluations=evaluations,
        warnings=(*identifiability_warnings(problem, minimum, quantities, covariance, own), *_unlearned(problem, minimum, residuals)),
        problem=problem,
        minimum=minimum,
    )  # fmt: skip


def _unlearned(problem: Problem, minimum: Minimum, residuals: Sequence[Array]) -> list[str]:
    """Say so where tables are fitted to what no function of tilt, rate and one memory is."""
    left = rms(residuals) / problem.records[0].std
    if not problem.smoothing:
        return []
    if changes_with_time(problem, minimum):
        return [
            "what is missing changes with time rather than with tilt and rate (warming, loosening): a spring and a damper that change during each "
            "release explain the releases better. Compare early releases with late ones"
        ]
    if left < 1.15 or correlation_length(residuals) < 1.5:
        return []
    return [
        f"a torque of tilt, rate and one memory leaves {left:.2f} times the noise: what is left changes with time (warming, "
        "loosening, another push), or the sensor's noise is not what it seems. Compare early releases with late ones"
    ]


def strength(problem: Problem, minimum: Minimum, effects: Sequence[str]) -> dict[str, float]:
    """Return the peak torque of effects over the peak torque of the joint, along the fitted motion."""
    law = JointLaw.from_vector(problem.structure, problem.vector_of(problem.parameters(minimum.point)))
    times = [record.time for record in problem.records]
    return torque_shares(law, times, problem.starts(minimum.point), effects)
