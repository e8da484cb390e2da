"""The joint under a simulator's time step: poles of MuJoCo's discrete map, from and to parameters, and its motion.

With spring, damper and inertia alone the step is a linear map of (roll, rate). Its determinant is `a = I/M`, its trace
`1 + a - h² k/M`, with the metric `M = I + h d`, or `I + h d + h² k` for 'discrete'. The poles of RK4 are the continuous ones to
1e-6 at the steps of a scene.
"""

import cmath
from collections.abc import Callable
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.joint.equations import EquationsOfMotion
from sysid.joint.law import JointLaw
from sysid.joint.mujoco_step import step
from sysid.joint.structure import Structure
from sysid.roll import Array


def continuous_map(inertia: float, stiffness: float, damping: float, timestep: float) -> tuple[float, float]:
    """Return (trace, determinant) of the motion of a continuous joint in one step h: e^(s₁h) + e^(s₂h), e^((s₁+s₂)h)."""
    root = cmath.sqrt(damping * damping - 4 * inertia * stiffness)
    poles = np.array([-damping + root, -damping - root]) / (2 * inertia)
    return float(np.exp(poles * timestep).sum().real), float(np.exp(-damping / inertia * timestep))


def step_map(
    inertia: float, stiffness: float, damping: float, timestep: float, integrator: str = "implicitfast"
) -> tuple[float, float]:
    """Return (trace, determinant) of MuJoCo's step of a joint; arguments as in `continuous_map`."""
    if integrator == "RK4":
        return continuous_map(inertia, stiffness, damping, timestep)
    h = timestep
    metric = inertia + h * damping + (h * h * stiffness if integrator == "discrete" else 0.0)
    determinant = inertia / metric
    return 1 + determinant - h * h * stiffness / metric, determinant


def joint_of_map(
    trace: float, determinant: float, stiffness: float, timestep: float, integrator: str = "implicitfast"
) -> tuple[float, float]:
    """Return (inertia [kg*m^2], damping [N*m*s/rad]) of the joint whose step of MuJoCo has that trace and determinant.

    The damping comes out negative where the integrator itself damps more.
    """
    h = timestep
    if integrator == "RK4":
        s = np.log(np.roots([1.0, -trace, determinant]).astype(complex)) / h
        inertia = stiffness / float((s[0] * s[1]).real)
        return inertia, -float((s[0] + s[1]).real) * inertia
    metric = h * h * stiffness / (1 + determinant - trace)
    inertia = determinant * metric
    if integrator == "discrete":
        return inertia, (metric - inertia) / h - h * stiffness
    return inertia, inertia * (1 / determinant - 1) / h


def sampled_k_d(inertia: float, stiffness: float, damping: float, timestep: float) -> tuple[float, float]:
    """Return (k, d) of the continuous joint of the same inertia that moves, at the samples, as implicitfast does.

    NaN where the step does not swing.
    """
    trace, determinant = step_map(inertia, stiffness, damping, timestep)
    cosine = trace / (2.0 * np.sqrt(determinant))
    if abs(cosine) >= 1:
        return float("nan"), float("nan")
    decay, frequency = -0.5 * np.log(determinant) / timestep, np.arccos(cosine) / timestep
    return float((decay**2 + frequency**2) * inertia), float(2 * decay * inertia)


def stepped(law: JointLaw, time: Array, angle: float, rate: float) -> tuple[Array, Array]:
    """Return roll [rad] and rate [rad/s] of a law that implicitfast steps at the law's own time step, shape (n,) each.

    Args:
        law: The joint; its torques may depend on tilt and rate only.
        time: Times [s], shape (n,), ascending, from 0 on; linear between steps.
        angle: Roll at release [rad].
        rate: Roll rate at release [rad/s].

    Raises:
        SysidError: The law has dry friction or memory.
    """
    plain = law.of_joint()
    if plain.structure.has_dry_friction or plain.structure.states:
        raise SysidError(
            f"a time step together with {', '.join(plain.structure.effects)}: the plain step loop holds smooth "
            "laws without memory only. Simulate the MJCF instead (husky-sysid mjcf)."
        )
    grid, *path = stepper(plain.structure, law.timestep, float(time[-1]))(plain.vector, angle, rate)
    return np.interp(time, grid, path[0]), np.interp(time, grid, path[1])


def stepper(structure: Structure, timestep: float, duration: float) -> Callable[[Array, float, float], Array]:
    """Return the motion as MuJoCo steps a joint, its dry friction as soft as a frictionloss by default.

    Args:
        structure: Effects without memory.
        timestep: [s].
        duration: Time that it covers at least [s].

    Returns:
        A function of parameters, shape (p,), roll [rad] and rate [rad/s] at release. It returns times [s], rolls [rad] and
        rates [rad/s], shape (3, n).
    """
    import casadi

    ca: Any = casadi
    p, y = ca.SX.sym("p", len(structure.parameters)), ca.SX.sym("y", 2)
    equations = EquationsOfMotion(structure, p)
    joint = equations.joint

    def torque(q: Any, v: Any) -> Any:
        return sum(equations.torques(ca.vertcat(q, v)))

    loss = equations.friction(y[0] - joint.rest_angle, 0.0)
    after = step(joint.inertia, torque, y[0], y[1], timestep=timestep, frictionloss=loss)
    count = int(duration / timestep) + 2
    moves = ca.Function("move", [y, p], [ca.vertcat(*after)]).mapaccum("moves", count)
    grid = timestep * np.arange(count + 1)

    def motion(vector: Array, angle: float, rate: float) -> Array:
        path = np.column_stack([[angle, rate], np.asarray(moves([angle, rate], vector))])
        return np.array([grid, *path], dtype=np.float64)

    return motion
