"""Residuals of a given law, with only the initial states of the releases fitted."""

from collections.abc import Sequence

import numpy as np

from sysid.effects._base import Scales
from sysid.errors import SysidError
from sysid.fitting.problem import Problem, starts_unknown
from sysid.fitting.records import Bias, Record
from sysid.joint import JointLaw
from sysid.progress import steps
from sysid.roll import Array


def fit_initial_states(
    law: JointLaw, records: Sequence[Record], *, bias: Bias = "shared"
) -> tuple[list[Array], list[tuple[float, float]]]:
    """Fit roll and rate at each release to a given law, and with 'per-release' the sensor's zero.

    Returns:
        Residuals of each record [rad or rad/s], shape (n,) each, and (roll [rad], rate [rad/s]) at each release.
    """
    residuals: list[Array] = []
    starts: list[tuple[float, float]] = []
    for problem in steps(problems_of_law(law, records, bias=bias)):
        found = problem.fitted(problem.start(problem.fixed), 30, 1e-7)
        if not np.isfinite(found.normal.cost):
            raise SysidError(
                "the record's law moves without bound from the measured release. Fit it to these logs."
            )
        residuals += problem.residuals(found.point)
        own = found.point * problem.sizes()
        starts.append((float(own[0]), float(own[1])))
    return residuals, starts


def problems_of_law(
    law: JointLaw, records: Sequence[Record], *, bias: Bias = "shared", steps_per_period: int = 120
) -> list[Problem]:
    """Return the least squares of a given law for each release by itself: only how it starts is free."""
    structure = law.structure
    amplitude = max(max(float(np.ptp(r.release.roll)) for r in records) / 1.6, 1e-4)
    scales = Scales(
        inertia=law.inertia, stiffness=max(law.frequency**2 * law.inertia, 1e-9), damping=max(law.damping, 0.0),
        amplitude=amplitude, duration=max(float(r.time[-1]) for r in records),
    )  # fmt: skip
    parameters = law.parameters
    del parameters["inertia"]
    one = Problem(
        structure, records[:1], scales, bias=bias, fixed=parameters, free_states=starts_unknown(structure, records),
        steps_per_period=steps_per_period,
    )  # fmt: skip
    return [one.with_(records=[record]) for record in records]
