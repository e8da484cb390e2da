"""Free decay of a joint in the user's own model: all other joints are held, and actuators are off."""

import mujoco
import numpy as np

from sim.board.clamped import ClampedScene
from sim.board.scene import integrator_name
from sim.model.arc import close, tangent_of, tied_to
from sim.model.setup import Setup
from sysid.roll import Array

HOLDING_ARMATURE = 1e9
"""Armature of joints that are held [kg*m^2 or kg]: torques move them by less than rounding."""


def scene_of(setup: Setup, *, timestep: float | None = None) -> ClampedScene:
    """Return a model in which only the joint, joints that loops tie to it, and free joints move.

    Actuators and contacts are off: a decay is measured without power, in the air. Step and integrator are the model's own.

    Args:
        timestep: Step instead of the model's [s].

    Raises:
        SysidError: The model cannot be read.
    """
    spec = setup.load()
    if timestep is not None:
        spec.option.timestep = timestep
    off = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
    spec.option.disableflags |= int(off)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = setup.posed(model)
    model.opt.jacobian, given = mujoco.mjtJacobian.mjJAC_DENSE, model.opt.jacobian
    own = int(model.jnt_dofadr[model.joint(setup.joint).id])
    moving = {own, *tied_to(model, data, own)} | {
        int(model.jnt_dofadr[setup.named(model, name)]) for name in setup.free
    }
    numbers = {int(model.dof_jntid[dof]) for dof in moving}
    for joint in spec.joints:
        if joint.id not in numbers:
            joint.armature = HOLDING_ARMATURE
    tied = sorted(tied_to(model, data, own))
    pose = np.array(data.qpos)
    model.opt.jacobian = given
    held = spec.compile()
    return ClampedScene(
        model=held,
        joint=setup.joint,
        name=f"{setup.file.name}, {integrator_name(held)} at {1e3 * held.opt.timestep:g} ms",
        begin=_Begin(pose, own, tied),
    )


class _Begin:
    """Sets the joint and closes the loops about it, positions and velocities."""

    def __init__(self, pose: Array, own: int, tied: list[int]) -> None:
        """Keep the pose, shape (nq,), and which velocities move."""
        self._pose, self._own, self._tied = pose, own, tied

    def __call__(self, model: mujoco.MjModel, data: mujoco.MjData, position: float, rate: float) -> None:
        data.qpos[:] = self._pose
        where = int(model.jnt_qposadr[model.dof_jntid[self._own]])
        if not self._tied:
            data.qpos[where], data.qvel[self._own] = position, rate
            return
        given, model.opt.jacobian = model.opt.jacobian, mujoco.mjtJacobian.mjJAC_DENSE
        steps = max(1, int(abs(position - data.qpos[where]) / 0.05))
        for _ in range(steps):
            tangent, _ = tangent_of(model, data, self._own, self._tied)
            mujoco.mj_integratePos(model, data.qpos, tangent * (position - self._pose[where]) / steps, 1.0)
            close(model, data, self._tied)
        tangent, _ = tangent_of(model, data, self._own, self._tied)
        model.opt.jacobian = given
        data.qvel[:] = rate * tangent
