"""MuJoCo's step of one hinge from numbers, and the joint of a compiled model that it is held against."""

from typing import Any

import casadi as ca
import mujoco
import numpy as np
from mujoco_rollout import rollout_function

from sysid.joint.mujoco_step import Hinge, Integrator, Torque


def simulate_steps(
    hinge: Hinge,
    start: tuple[float, float],
    steps: int,
    *,
    timestep: float,
    integrator: Integrator = "implicitfast",
) -> np.ndarray:
    """Return positions [rad] and velocities [rad/s], shape (steps + 1, 2), from numbers alone; the start is row 0."""
    rollout = rollout_function(hinge, ca.SX.sym("none", 0), steps, timestep=timestep, integrator=integrator)
    return np.vstack([start, np.array(rollout(ca.DM(start), ca.DM.zeros(0, 1))).T])


def hinge_from_model(model: mujoco.MjModel, joint: str, *, torque: Torque | None = None) -> Hinge:
    """Read the only joint of a compiled model.

    Args:
        model: Compiled MuJoCo model with one hinge joint.
        torque: What acts on the joint besides spring, damper, friction and limits.
    """
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((1, 1))
    mujoco.mj_fullM(model, data, mass)
    index, dof = model.joint(joint).id, int(model.joint(joint).dofadr[0])
    armature = float(model.dof_armature[dof])
    return Hinge(
        inertia=float(mass[0, 0]) - armature,
        armature=armature,
        stiffness=(float(model.jnt_stiffness[index]), *numbers(model.jnt_stiffnesspoly[index])),
        damping=(float(model.dof_damping[dof]), *numbers(model.dof_dampingpoly[dof])),
        springref=float(model.qpos_spring[model.jnt_qposadr[index]]),
        frictionloss=float(model.dof_frictionloss[dof]),
        solref_friction=numbers(model.dof_solref[dof]),
        solimp_friction=numbers(model.dof_solimp[dof]),
        limits=numbers(model.jnt_range[index]) if model.jnt_limited[index] else None,
        solref_limit=numbers(model.jnt_solref[index]),
        solimp_limit=numbers(model.jnt_solimp[index]),
        torque=torque,
        eulerdamp=not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP),
    )


def numbers(values: Any) -> tuple[float, ...]:
    return tuple(map(float, values))
