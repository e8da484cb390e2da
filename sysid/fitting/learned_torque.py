"""The torque that a fit has learned, with its band."""

import numpy as np

from sysid.effects._algebra import NUMPY
from sysid.effects._base import JointState, TorqueEffect
from sysid.fitting.result import JointFit
from sysid.roll import Array


def learned_torque(
    fit: JointFit, tilt: Array, rate: Array, *, with_joint: bool = False
) -> tuple[Array, Array]:
    """Return the torque of a fit's tables of tilt [rad] and rate [rad/s], and its deviation [N*m], shape (n,) each.

    Tilt counts from the rest angle. What is learned has no linear part of its own, so alone it depends on how spring and
    damper were told apart from it; the sum, `with_joint`, does not.
    """
    law, names = fit.law, list(fit.quantities)
    motion = JointState(tilt, rate, tilt + law.rest_angle, law.stiffness)
    rows = np.zeros((len(names), len(tilt)))
    for part in law.structure.torques:
        if part.smoothness is None or part.states:
            continue
        values = part.named(dict(law.effects)[part.name])
        zero = {**values, **dict.fromkeys(part.smoothness().names, 0.0)}
        for name in part.smoothness().names:
            if (key := f"{part.name}.{name}") in fit.quantities:
                rows[names.index(key)] = part.torque(NUMPY, motion, {**zero, name: 1.0}, ())
    if with_joint:
        for name, slope in (("stiffness", -tilt), ("damping", -rate)):
            if name in fit.quantities:
                rows[names.index(name)] = slope
    values = np.array([quantity.value for quantity in fit.quantities.values()])
    variance = np.einsum("in,ij,jn->n", rows, fit.covariance, rows)
    return values @ rows, np.sqrt(np.maximum(variance, 0.0))


def tables_of(fit: JointFit) -> tuple[TorqueEffect, ...]:
    """Return the effects of a fit that are tables of tilt and rate."""
    return tuple(part for part in fit.law.structure.torques if part.smoothness and not part.states)
