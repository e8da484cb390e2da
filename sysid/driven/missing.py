"""The torque that a model misses along a log: motion and torques through one low-pass filter, as in the inverse dynamics of robots.

Source: Gautier, Janot and Vandanjon, IEEE Trans. Control Syst. Technol. 21 (2013), for the filtering of both sides.
"""

from collections.abc import Mapping

import numpy as np

from sysid.driven.problem import Problem
from sysid.effects._algebra import NUMPY
from sysid.effects._base import Actuation, DriveEffect, JointState, TorqueEffect
from sysid.roll import Array


def torque_along(problem: Problem, values: Mapping[str, float]) -> Array:
    """Return the torque of a model along a log, through the log's filter [N*m], shape (n,): 0 where nothing is missing.

    It is load, actuator, springs and friction less what accelerates the joint. Effects with states and gears count as absent.
    """
    log, structure = problem.log, problem.structure
    motion = log.motion
    q, v, a = motion.angle, motion.rate, motion.acceleration
    late = log.late_input(values[structure.delay] if structure.delay else 0.0)
    tilt = q - values["rest_angle"]
    state = JointState(tilt, v, q, values["stiffness"])
    inertia, torque, slope, at = (np.interp(motion.time, log.load_time, row) for row in log.load.rows[:4])
    torque = torque + slope * (q - values["zero"] - at) + values["bias"]
    torque = torque - values["stiffness"] * tilt - values["damping"] * v - (inertia + values["armature"]) * a
    acted: Array = np.zeros_like(q)
    for part in sorted(structure.parts, key=lambda part: getattr(part, "stage", 0)):
        own = {p.name: values[f"{part.name}.{p.name}"] for p in part.parameters}
        if isinstance(part, DriveEffect):
            acted = part.act(NUMPY, Actuation(late, acted, q, v), own)
        elif isinstance(part, TorqueEffect) and not part.states:
            torque = torque + part.torque(NUMPY, state, own, ())
            if part.friction is not None:
                torque = torque - np.sign(v) * part.friction(NUMPY, tilt, np.abs(v), own)
    return motion.filtered(torque + acted)[motion.inside]


def linear_start(
    problem: Problem, values: Mapping[str, float], names: tuple[str, ...]
) -> tuple[dict[str, float], float]:
    """Return the parameters after one Gauss–Newton step of some to the least missing torque, and that torque [N*m]."""
    from scipy.optimize import lsq_linear

    here = torque_along(problem, values)
    if not names:
        return dict(values), float(np.sqrt(np.mean(here**2)))
    columns: list[Array] = []
    room: list[tuple[float, float]] = []
    for name in names:
        bottom, top = problem.limits_of(name)
        step = 1e-3 * max(abs(values[name]), 1e-3 * (top - bottom))
        step = -step if values[name] + step > top else step
        columns.append((torque_along(problem, {**values, name: values[name] + step}) - here) / step)
        room.append((bottom - values[name], top - values[name]))
    scale = 1 / np.maximum(np.linalg.norm(columns, axis=1), 1e-300)
    low, high = np.array(room).T / scale
    low, high = np.minimum(low, -1e-12), np.maximum(high, 1e-12)
    solved = lsq_linear(np.stack(columns, axis=1) * scale, -here, (low, high))
    moved = {
        name: float(np.clip(values[name] + x, *problem.limits_of(name)))
        for name, x in zip(names, solved.x * scale, strict=True)
    }
    return {**values, **moved}, float(np.sqrt(2 * solved.cost / len(here)))
