"""Actuators of a joint: the stiffness and damping by which one holds the joint without a command."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sim.model.setup import Setup

SMALL = 1e-3
"""Displacement and rate by which an actuator is probed [rad or m, and per second]."""


@dataclass(frozen=True, slots=True)
class Servo:
    """One actuator on the joint, without a command."""

    name: str
    stiffness: float
    """[N*m/rad or N/m]."""
    damping: float
    """[N*m*s/rad or N*s/m]."""

    def text(self, *, slides: bool) -> str:
        """Return its name and numbers, for messages."""
        units = ("N/m", "N·s/m") if slides else ("N·m/rad", "N·m·s/rad")
        sizes = zip(("holds with", "brakes with"), (self.stiffness, self.damping), units, strict=True)
        words = [f"{word} {size:.4g} {unit}" for word, size, unit in sizes if size]
        return f"actuator '{self.name}'" + (f" ({', '.join(words)})" if words else "")


def servos_of(setup: Setup, spec: mujoco.MjSpec) -> list[Servo]:
    """Return the actuators that act on the joint in its pose, through whichever transmission."""
    model = spec.compile()
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    joint = model.joint(setup.joint)
    dof, where = int(joint.dofadr[0]), int(joint.qposadr[0])
    pose, forces, moment = setup.posed(model), [], np.zeros((model.nu, model.nv))
    for q, v in ((0.0, 0.0), (SMALL, 0.0), (0.0, SMALL)):
        data = mujoco.MjData(model)
        data.qpos[:] = pose
        data.qpos[where] += q
        data.qvel[dof] = v
        mujoco.mj_forward(model, data)
        if model.nu:
            mujoco.mju_sparse2dense(
                moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
            )
        forces.append(moment[:, dof] * data.actuator_force)
    still, moved, fast = np.array(forces)
    return [
        Servo(
            model.actuator(i).name or str(i),
            *(float(f"{x:.6g}") for x in ((still - moved)[i] / SMALL, (still - fast)[i] / SMALL)),
        )
        for i in np.flatnonzero(np.abs(moment[:, dof]) > 0)
    ]
