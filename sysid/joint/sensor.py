"""The sensor model: filter, bias, drift and the log's clock.

A filter has a state, so it is integrated with the joint. Everything else is applied at the samples, after the
filters. The log's clock counts from the log's first sample; drift grows with it, wherever a release begins.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from sysid.effects._algebra import NUMPY, Algebra, Value
from sysid.effects._base import JointState, Reading, SensorEffect
from sysid.joint.equations import EquationsOfMotion, casadi_algebra, items_of
from sysid.joint.law import JointLaw
from sysid.joint.structure import Structure
from sysid.roll import Array


def filtered(equations: EquationsOfMotion, y: Any) -> tuple[Value, Value]:
    """Return angle and rate as they leave the filters of the sensor, for a state of the joint."""
    reading = Reading(y[0], y[1], None)
    for part, values, states in equations.layout:
        if isinstance(part, SensorEffect) and part.states:
            reading = part.observe(equations.m, reading, values, items_of(y, states))
    return reading.angle, reading.rate


def at_samples(structure: Structure) -> tuple[SensorEffect, ...]:
    """Return the effects of a structure that are applied to samples."""
    return tuple(part for part in structure.parts if isinstance(part, SensorEffect) and not part.states)


def clock_ratio(structure: Structure, parameters: Mapping[str, float]) -> float:
    """Return the ratio of the log's time to true time, from parameters by name; 1 for a right clock."""
    ratio = 1.0
    for part in at_samples(structure):
        if part.clock_ratio:
            ratio *= parameters[f"{part.name}.{part.clock_ratio}"]
    return ratio


def read(law: JointLaw, angle: Array, rate: Array, time: Array) -> Reading:
    """Return a law's sensor readings of samples behind its filters, shape (n,) each.

    Angles [rad], rates per second of the log's clock [rad/s], and times on that clock [s].
    """
    values = dict(law.effects)
    reading = Reading(angle, rate, time)
    for part in at_samples(law.structure):
        reading = part.observe(NUMPY, reading, part.named(values[part.name]), ())
    return reading


@cache
def reader(structure: Structure) -> Any:
    """Return the CasADi function (angle, rate, time, parameters) → (reading, derivatives), for one sample.

    The reading is angle and rate, shape (2,); the derivatives are by angle, rate and all parameters but the
    inertia, shape (2, p + 1).
    """
    import casadi

    ca: Any = casadi
    angle, rate, time = (ca.SX.sym(name) for name in ("angle", "rate", "time"))
    parameters = ca.SX.sym("parameters", len(structure.parameters))
    reading = Reading(angle, rate, time)
    for part, where, _ in structure.layout():
        if isinstance(part, SensorEffect) and not part.states:
            reading = part.observe(casadi_algebra(), reading, part.named(items_of(parameters, where)), ())
    out = ca.vertcat(reading.angle, reading.rate)
    slopes = ca.jacobian(out, ca.vertcat(angle, rate, parameters[1:]))
    return ca.Function("reading", [angle, rate, time, parameters], [out, ca.densify(slopes)])


def sense(law: JointLaw, time: Array, roll: Array) -> Array:
    """Return the readings of a law's sensor for a given motion, from the release on [rad], shape (n,).

    Times are on the log's clock [s], shape (n,), the deck's roll in rad.
    """
    rate = np.gradient(roll, time)
    for part in law.structure.parts:
        if isinstance(part, SensorEffect) and part.states:
            roll = _filter(part, law, time, roll, rate)
            rate = np.gradient(roll, time)
    return np.asarray(read(law, roll, rate, time).angle)


def _filter(part: SensorEffect, law: JointLaw, time: Array, roll: Array, rate: Array) -> Array:
    """Integrate a filter along samples by the linearly implicit midpoint rule: stable however fast the filter is."""
    import casadi

    ca: Any = casadi
    m: Algebra = casadi_algebra()
    values = part.named(dict(law.effects)[part.name])
    z, h, angle, speed = ca.SX.sym("z", len(part.states)), ca.SX.sym("h"), ca.SX.sym("a"), ca.SX.sym("v")
    motion = JointState(angle - law.rest_angle, speed, angle, law.stiffness)
    states = items_of(z, slice(0, len(part.states)))
    rates = ca.vertcat(*(s.rate(m, motion, states, values) if s.rate else 0.0 for s in part.states))
    implicit = ca.SX.eye(len(part.states)) - h / 2 * ca.jacobian(rates, z)
    step = ca.Function("step", [z, ca.vertcat(h, angle, speed)], [z + h * ca.solve(implicit, rates)])
    first = [s.start(NUMPY, roll[0], np.inf, law.stiffness, values) for s in part.states]
    between = np.vstack([np.diff(time), *((x[1:] + x[:-1]) / 2 for x in (roll, rate))])
    path = np.hstack(
        [np.reshape(first, (-1, 1)), step.mapaccum("steps", len(time) - 1)(first, between).full()]
    )
    return np.asarray(part.observe(NUMPY, Reading(roll, rate, time), values, list(path)).angle)
