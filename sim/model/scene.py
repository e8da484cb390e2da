"""Free decay of a joint in the user's own model, and of a board in the user's own scene."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from sim.board.bodies import TILT_JOINT
from sim.board.clamped import Begin, ClampedScene
from sim.board.scene import integrator_name
from sim.compensation.scene import hold
from sim.model.arc import close, tangent_of, tied_to
from sim.model.setup import Setup, switch_off
from sysid.errors import SysidError
from sysid.roll import Array

HOLDING_ARMATURE = 1e9
"""Armature of joints that are held [kg*m^2 or kg]: torques move them by less than rounding."""


def scene_from_file(path: Path, *, joint: str = TILT_JOINT, timestep: float | None = None) -> ClampedScene:
    """Read any MJCF scene with a board in it and hold its chassis.

    Args:
        joint: Name of the tilt joint, with prefix; its axis is +x or -x.
        timestep: Step instead of the file's [s].

    Raises:
        SysidError: The file cannot be read or compiled, or has no such joint.
    """
    setup = Setup(file=path, joint=joint)
    spec = setup.read()
    axis = np.asarray(setup.joint_of(spec).axis)
    if abs(axis[0]) < 0.999 * np.linalg.norm(axis):
        raise SysidError(f"{path}: joint '{joint}' turns about {axis}; a tilt joint turns about +x or -x.")
    setup.compiled(spec)
    spec.option.timestep = timestep or spec.option.timestep
    hold(spec, joint)
    return _scene(setup, spec)


def scene_of(setup: Setup, *, timestep: float | None = None) -> ClampedScene:
    """Return a model in which only the joint, joints that loops tie to it, and free joints move.

    Actuators and contacts are off: a decay is measured without power, in the air. Step and integrator are the model's own.

    Args:
        timestep: Step instead of the model's [s].

    Raises:
        SysidError: The model cannot be read.
    """
    spec = setup.load()
    spec.option.timestep = timestep or spec.option.timestep
    switch_off(spec.option, "CONTACT", "ACTUATION")
    model = setup.compiled(spec)
    data = mujoco.MjData(model)
    data.qpos[:] = pose = setup.posed(model)
    own = int(model.joint(setup.joint).dofadr[0])
    tied = sorted(tied_to(model, data, own))
    free = (int(model.jnt_dofadr[setup.named(model, name)]) for name in setup.free)
    moving = {int(model.dof_jntid[dof]) for dof in (own, *tied, *free)}
    for joint in spec.joints:
        if joint.id not in moving:
            joint.armature = HOLDING_ARMATURE
    return _scene(setup, spec, partial(_begin, pose=pose, own=own, tied=tied))


def _scene(setup: Setup, spec: mujoco.MjSpec, begin: Begin | None = None) -> ClampedScene:
    model = spec.compile()
    name = f"{setup.file.name}, {integrator_name(model)} at {1e3 * model.opt.timestep:g} ms"
    return ClampedScene(model=model, joint=setup.joint, name=name, begin=begin)


def _begin(
    model: mujoco.MjModel, data: mujoco.MjData, position: float, rate: float, *, pose: Array, own: int,
    tied: Sequence[int],
) -> None:  # fmt: skip
    """Set the joint and close the loops about it, positions and velocities."""
    data.qpos[:] = pose
    where = int(model.jnt_qposadr[model.dof_jntid[own]])
    if not tied:
        data.qpos[where], data.qvel[own] = position, rate
        return
    steps = max(1, int(abs(position - data.qpos[where]) / 0.05))
    for _ in range(steps):
        tangent, _ = tangent_of(model, data, own, tied)
        mujoco.mj_integratePos(model, data.qpos, tangent * (position - pose[where]) / steps, 1.0)
        close(model, data, tied)
    data.qvel[:] = rate * tangent_of(model, data, own, tied)[0]
