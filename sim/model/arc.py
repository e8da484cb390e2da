"""A model that moves along the arc of one joint, everything else held, free, or carried along by its loops."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sim.model.setup import Setup
from sysid.errors import SysidError
from sysid.roll import Array

POINTS = 60
"""Places along the arc to either side of the pose at which the model is looked at."""
ARC_LIMITS = {int(mujoco.mjtJoint.mjJNT_HINGE): np.pi, int(mujoco.mjtJoint.mjJNT_SLIDE): 1.0}
"""How far the arc of a joint without limits goes to either side [rad or m]."""
MAX_LOOP_GAP = 1e-7
"""How far a loop may be open once it is closed [m or rad]."""
IN_LOOP = 1.0
"""The same of a joint that a loop ties to others [rad or m]."""
MAX_LOOP_RATIO = 30.0
"""A loop whose joints move by so many times more than this one is near the end of its way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Arc:
    """Inertia and torques of one joint along its arc."""

    position: Array
    """Of the joint [rad or m], shape (n,), ascending."""
    qpos: Array
    """Of the model there, shape (n, nq)."""
    inertia: Array
    """That the joint sees, armature included [kg*m^2 or kg], shape (n,)."""
    pull: Array
    """Weight, and springs other than the joint's own, towards larger positions [N*m or N], shape (n,)."""
    damping: Array
    """Of what it carries along, without its own [N*m*s/rad or N*s/m], shape (n,)."""
    carried: tuple[str, ...]
    """Joints that move with it."""
    loose: bool
    """Whether nothing but inertia says how they do."""

    def at(self, position: float, values: Array) -> float:
        """Return one of the tables at a position."""
        return float(np.interp(position, self.position, values))


def walk(setup: Setup, spec: mujoco.MjSpec) -> Arc:
    """Move the joint along its arc.

    The mass matrix is the model's own, reduced to this joint: with v = T q̇ for all velocities, T = 1 here and 0 where
    joints are held, T solves the loops (equality constraints) and makes vᵀ M v least where they leave a choice, which for
    joints that are free is the Schur complement. The pull is Tᵀ (passive forces - bias forces) at rest.

    Raises:
        SysidError: The pose violates a loop, or a joint that was named is not there.
    """
    try:
        model = spec.compile()
    except ValueError as error:  # read, but not physical: a moving body without a mass
        said = " ".join(str(error).removeprefix("Error: ").split())
        raise SysidError(f"{setup.file}: MuJoCo cannot compile it ({said}).") from error
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    model.opt.disableflags |= int(
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
        | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS | mujoco.mjtDisableBit.mjDSBL_ACTUATION
    )  # fmt: skip
    number = model.joint(setup.joint).id
    own, where = int(model.jnt_dofadr[number]), int(model.jnt_qposadr[number])
    model.jnt_stiffness[number] = 0.0
    model.jnt_stiffnesspoly[number] = 0.0
    data = mujoco.MjData(model)
    data.qpos[:] = setup.posed(model)
    tied = sorted(tied_to(model, data, own))
    movable = sorted(
        {*tied, *(int(model.jnt_dofadr[setup.named(model, name)]) for name in setup.free)} - {own}
    )
    if not close(model, data, tied):
        raise SysidError(
            f"{setup.file}: the loops do not close in this pose. Give one that they allow (--keyframe, --pose)."
        )
    jacobian, _ = _loops(model, data)
    if np.abs(jacobian @ tangent_of(model, data, own, movable)[0]).max(initial=0.0) > 1e-6:
        raise SysidError(
            f"{setup.file}: an equality constraint holds the joint '{setup.joint}', so it is not passive. Switch it off "
            '(active="false"), as it was in the measurement.'
        )
    low, high = model.jnt_range[number] if model.jnt_limited[number] else (-np.inf, np.inf)
    start, reach = float(data.qpos[where]), IN_LOOP if tied else ARC_LIMITS[int(model.jnt_type[number])]
    middle = np.array(data.qpos)
    rows = [_row(model, data, own, movable)]
    places = [middle]
    for end in (max(low, start - reach), min(high, start + reach)):
        data.qpos[:] = middle
        for _ in range(POINTS):
            if abs(end - start) < 1e-9 or not _step(model, data, own, tied, (end - start) / POINTS):
                break
            rows.append(_row(model, data, own, movable))
            places.append(np.array(data.qpos))
    table, qpos = np.array(rows), np.array(places)
    order = np.argsort(qpos[:, where])
    carried = [model.joint(int(model.dof_jntid[dof])).name for dof in movable]
    return Arc(
        position=qpos[order, where], qpos=qpos[order], inertia=table[order, 0], pull=table[order, 1],
        damping=table[order, 2], carried=tuple(dict.fromkeys(carried)),
        loose=bool(movable) and np.linalg.matrix_rank(_loops(model, data)[0][:, movable], 1e-8) < len(movable),
    )  # fmt: skip


def _loops(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, Array]:
    """Return Jacobian, shape (e, nv), and error, shape (e,), of the active equality constraints."""
    data.qvel[:] = 0.0
    mujoco.mj_forward(model, data)
    rows = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    jacobian = np.array(data.efc_J).reshape(data.nefc, model.nv) if data.nefc else np.zeros((0, model.nv))
    return jacobian[rows] if data.nefc else jacobian, np.array(data.efc_pos)[rows]


def tied_to(model: mujoco.MjModel, data: mujoco.MjData, own: int) -> set[int]:
    """Return the other velocities that loops tie to one, however indirectly."""
    touched = np.abs(_loops(model, data)[0]) > 1e-9
    found, before = {own}, 0
    while len(found) > before:
        before = len(found)
        rows = touched[:, sorted(found)].any(axis=1)
        found |= set(np.flatnonzero(touched[rows].any(axis=0)).tolist())
    return found - {own}


def close(model: mujoco.MjModel, data: mujoco.MjData, movable: Sequence[int]) -> bool:
    """Move what may move until the loops are closed; False where they cannot be."""
    for _ in range(30):
        jacobian, error = _loops(model, data)
        inside = np.abs(jacobian[:, movable]).sum(axis=1) > 1e-9
        if not np.any(np.abs(error[inside]) > MAX_LOOP_GAP):
            return True
        change = np.zeros(model.nv)
        change[list(movable)] = -np.linalg.lstsq(jacobian[inside][:, movable], error[inside], rcond=1e-8)[0]
        mujoco.mj_integratePos(model, data.qpos, change, 1.0)
    return False


def tangent_of(
    model: mujoco.MjModel, data: mujoco.MjData, own: int, movable: Sequence[int]
) -> tuple[Array, Array]:
    """Return T, shape (nv,), and the mass matrix, shape (nv, nv)."""
    jacobian, _ = _loops(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    tangent = np.zeros(model.nv)
    tangent[own] = 1.0
    if movable:
        loops = jacobian[:, movable]
        m, e = len(movable), len(loops)
        matrix = np.zeros((m + e, m + e))
        matrix[:m, :m], matrix[:m, m:], matrix[m:, :m] = mass[np.ix_(movable, movable)], loops.T, loops
        right = -np.concatenate([mass[movable, own], jacobian[:, own]])
        tangent[movable] = np.linalg.lstsq(matrix, right, rcond=1e-12)[0][:m]
    return tangent, mass


def _row(
    model: mujoco.MjModel, data: mujoco.MjData, own: int, movable: Sequence[int]
) -> tuple[float, float, float]:
    """Return inertia, pull and damping of what is carried along, where the model is."""
    tangent, mass = tangent_of(model, data, own, movable)
    pull = tangent @ (data.qfrc_passive - data.qfrc_bias)
    others = np.delete(tangent**2 * model.dof_damping, own)
    return float(tangent @ mass @ tangent), float(pull), float(others.sum())


def _step(model: mujoco.MjModel, data: mujoco.MjData, own: int, movable: Sequence[int], by: float) -> bool:
    """Move the joint and what it carries along; False where the loops end."""
    tangent, _ = tangent_of(model, data, own, movable)
    if np.abs(tangent).max() > MAX_LOOP_RATIO:
        return False
    mujoco.mj_integratePos(model, data.qpos, tangent * by, 1.0)
    if not close(model, data, movable):
        return False
    joints = [int(model.dof_jntid[dof]) for dof in movable if model.jnt_limited[model.dof_jntid[dof]]]
    places = data.qpos[model.jnt_qposadr[joints]]
    if np.any(places < model.jnt_range[joints, 0]) or np.any(places > model.jnt_range[joints, 1]):
        return False
    mujoco.mj_forward(model, data)
    return True
