"""MuJoCo's step of one joint, written in CasADi: implicitfast, with its default dry friction.

For a single joint MuJoCo's forward dynamics, constraint solver and integrator have a closed form. The smooth torque is
implicit in the velocity. Friction loss is a convex problem in one unknown, solved by a clip. The step has exact derivatives with
respect to state and parameters, and equals MuJoCo's to rounding.

Source: MuJoCo documentation 4.0, chapters Computation (constraint model, integrators) and Modeling
(solver parameters); every formula is compared with MuJoCo itself in `tests/joint/test_mujoco_step.py`.
"""

from collections.abc import Callable
from typing import Any

import casadi as ca
import mujoco

Expression = Any
"""A CasADi expression or a float."""
Torque = Callable[[Expression, Expression], Expression]
"""Smooth torque [N*m] of position [rad] and velocity [rad/s]."""


def step(
    inertia: Expression, torque: Torque, q: Expression, v: Expression, *, timestep: Expression,
    frictionloss: Expression = 0.0,
) -> tuple[Expression, Expression]:  # fmt: skip
    """Advance position [rad] and velocity [rad/s] by one MuJoCo step.

    Args:
        inertia: Inertia about the axis, armature included [kg*m^2].
        torque: Spring, damper and all else that is smooth.
        q: Position, as qpos [rad].
        v: Velocity, as qvel [rad/s].
        timestep: [s].
        frictionloss: Dry friction [N*m]; with the float 0.0 there is no friction constraint.
    """
    force = torque(q, v)
    damping = -ca.jacobian(force, v)
    if not isinstance(frictionloss, float) or frictionloss:
        force = force + _friction(inertia, force, v, timestep, frictionloss)
    velocity = v + timestep * force / (inertia + timestep * damping)
    return q + timestep * velocity, velocity


def _friction(
    inertia: Expression, force: Expression, v: Expression, timestep: Expression, loss: Expression
) -> Expression:
    """Return the friction that minimises ½ I (a - force/I)² + s(a) [N*m], with solreffriction and solimpfriction at their defaults.

    Here s is quadratic around the reference acceleration -b v, with the weight I d / (1 - d), and linear where friction slips. The
    impedance d is that at distance 0; b = 2 / (d_width T), with T at least two steps (the flag refsafe).
    """
    default = mujoco.MjSpec().default.joint
    impedance, end = (float(value) for value in default.solimp_friction[:2])
    damper = 2 / (end * ca.fmax(float(default.solref_friction[0]), 2 * timestep))
    weight = inertia * impedance / (1 - impedance)
    stick = weight * (-damper * v * inertia - force) / (inertia + weight)
    return ca.fmin(ca.fmax(stick, -loss), loss)
