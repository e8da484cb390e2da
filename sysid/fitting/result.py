"""A fitted joint: its law, its parameters with their uncertainty, and the residual."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from sysid.board import Board
from sysid.fitting.covariance import (
    common_covariance,
    correlation_of,
    identifiability_warnings,
    parameter_covariance,
    parameter_quantities,
)
from sysid.fitting.cross_validation import heldout_residuals, rms
from sysid.fitting.problem import Problem
from sysid.fitting.records import Bias, Record, read_at_rest
from sysid.joint.law import JointLaw
from sysid.least_squares import Minimum
from sysid.noise.floor import NoiseFloor
from sysid.quantity import Quantity
from sysid.roll import Array

TOLERANCE = 0.02
"""Error beyond the noise, over the RMS of the motion, up to which a law passes for the measured one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFit:
    """A fitted joint with its uncertainty."""

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
        return motion_rms(self.law, self.records, self.problem.bias)

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


def motion_rms(law: JointLaw, records: Sequence[Record], bias: Bias) -> float:
    """Return the RMS of the measurements about the rest of a law [rad or rad/s]."""
    rests = (read_at_rest(record, law.posed(record.release.known).rest_angle, bias) for record in records)
    return rms([record.signal - rest for record, rest in zip(records, rests, strict=True)])


def summarise(
    problem: Problem, minimum: Minimum, board: Board, noise: NoiseFloor, evaluations: int
) -> JointFit:
    """Turn a minimum into quantities with uncertainty."""
    residuals = problem.residuals(minimum.point)
    own = parameter_covariance(problem, minimum, residuals)
    covariance = own + common_covariance(problem, minimum, board)
    quantities = parameter_quantities(problem, minimum, covariance, slides=board.slides)
    return JointFit(
        law=JointLaw.from_vector(
            problem.structure, problem.vector_of(problem.parameters(minimum.point))
        ),
        quantities=quantities,
        covariance=covariance,
        own_covariance=own,
        rmse=rms(residuals),
        noise=noise,
        records=tuple(problem.records),
        starts=tuple(problem.starts(minimum.point)),
        residuals=tuple(residuals),
        evaluations=evaluations,
        warnings=tuple(identifiability_warnings(problem, minimum, quantities, covariance, own)),
        problem=problem,
        minimum=minimum,
    )  # fmt: skip
