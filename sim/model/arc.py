"""A model moved along the arc of one joint: the other joints are held, free, or carried along by loops."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sim.model.setup import Setup, switch_off
from sysid.errors import SysidError
from sysid.roll import Array

POINTS = 60
"""Points of the arc on either side of the pose: three harmonics fitted to a pendulum's half turn are exact to 1e-12."""
REACH = {"hinge": np.pi, "slide": 1.0, "loop": 1.0}
"""Length of the path on either side without a limit [rad or m]; a loop may jam earlier."""
CLOSED = 1e-7
"""Gap of a closed loop, and size of an entry of its Jacobian that counts [m or rad]."""
MAX_LOOP_RATIO = 30.0
"""Velocity ratio of a loop above which the arc ends: the loop is near a dead centre, where the ratio is infinite."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Arc:
    """Inertia and torques of one joint along its arc, shape (n,) each."""

    position: Array
    """Of the joint [rad or m], ascending."""
    qpos: Array
    """Of the model there, shape (n, nq)."""
    inertia: Array
    """Inertia that the joint sees, armature included [kg*m^2 or kg]."""
    weight: Array
    """Torque of gravity [N*m or N]."""
    springs: Array
    """Torque of tendons and of carried joints' springs, not of the joint's own spring [N*m or N]."""
    damping: Array
    """Damping by tendons, carried joints and a fluid, not by the joint's own damper [N*m*s/rad or N*s/m]."""
    friction: Array
    """Dry friction of tendons and carried joints, not of the joint itself [N*m or N]."""
    carried: tuple[str, ...]
    """Joints that move with it."""
    loose: bool
    """Whether a carried joint follows by its inertia alone."""
    closed: bool
    """Whether the arc is a full turn, so that its ends are one place."""

    @property
    def pull(self) -> Array:
        """Torque of weight and springs, the joint's own spring excepted [N*m or N], shape (n,)."""
        return self.weight + self.springs

    def at(self, position: float, values: Array) -> float:
        """Return one of the tables at a position."""
        return float(np.interp(position, self.position, values))


def walk(setup: Setup, spec: mujoco.MjSpec) -> Arc:
    """Move the joint along its arc.

    The mass matrix is the model's, reduced to this joint. All velocities are v = T q̇, with T = 1 for the joint and 0 for
    joints that are held. T satisfies the loops (equality constraints) and minimises vᵀ M v where they leave a choice: for
    free joints that is the Schur complement. Torques are projected by Tᵀ.

    Raises:
        SysidError: The pose violates a loop, or a named joint is missing.
    """
    model = _passive(setup, spec)
    number = model.joint(setup.joint).id
    own, where = int(model.jnt_dofadr[number]), int(model.jnt_qposadr[number])
    data = mujoco.MjData(model)
    data.qpos[:] = setup.posed(model)
    tied = sorted(tied_to(model, data, own))
    free = {int(model.jnt_dofadr[setup.named(model, name)]) for name in setup.free}
    movable = sorted({*tied, *free} - {own})
    _require_motion(setup, model, data, own, tied, movable)
    limited, hinge = bool(model.jnt_limited[number]), model.jnt_type[number] == mujoco.mjtJoint.mjJNT_HINGE
    low, high = model.jnt_range[number] if limited else (-np.inf, np.inf)
    if not tied:  # a model's zero may lie outside the range
        data.qpos[where] = min(max(data.qpos[where], low), high)
    start, reach = float(data.qpos[where]), REACH["loop" if tied else "hinge" if hinge else "slide"]
    middle = np.array(data.qpos)
    rows, places = [_row(model, data, own, movable)], [middle]
    for end in (max(low, start - reach), min(high, start + reach)):
        data.qpos[:] = middle
        for _ in range(POINTS):
            if abs(end - start) < 1e-9 or not _step(model, data, own, tied, (end - start) / POINTS):
                break
            rows.append(_row(model, data, own, movable))
            places.append(np.array(data.qpos))
    qpos = np.array(places)
    order = np.argsort(qpos[:, where])
    inertia, weight, springs, damping, friction = np.array(rows)[order].T
    carried = [model.joint(int(model.dof_jntid[dof])).name for dof in movable]
    return Arc(
        position=qpos[order, where], qpos=qpos[order], inertia=inertia, weight=weight, springs=springs, damping=damping,
        friction=friction, carried=tuple(dict.fromkeys(carried)),
        loose=bool(movable) and np.linalg.matrix_rank(_loops(model, data)[0][:, movable], 1e-8) < len(movable),
        closed=bool(hinge) and not limited and not tied,
    )  # fmt: skip


def _passive(setup: Setup, spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the model without contacts, limits, friction, power, and the joint's own spring and damper.

    Raises:
        SysidError: It does not compile.
    """
    model = setup.compiled(spec)
    switch_off(model.opt, "CONTACT", "LIMIT", "FRICTIONLOSS", "ACTUATION")
    joint = model.joint(setup.joint)
    for name in ("jnt_stiffness", "jnt_stiffnesspoly"):
        getattr(model, name)[joint.id] = 0.0
    for name in ("dof_damping", "dof_dampingpoly", "dof_frictionloss"):
        getattr(model, name)[int(joint.dofadr[0])] = 0.0
    return model


def _require_motion(
    setup: Setup, model: mujoco.MjModel, data: mujoco.MjData, own: int, tied: Sequence[int], movable: Sequence[int]
) -> None:  # fmt: skip
    """Check that the loops close in the pose and let the joint move.

    Raises:
        SysidError: They do not.
    """
    if not close(model, data, tied):
        raise SysidError(
            f"{setup.file}: the loops do not close in this pose. Give a pose in which they do (--keyframe, --pose)."
        )
    jacobian, _ = _loops(model, data)
    if np.abs(jacobian @ tangent_of(model, data, own, movable)[0]).max(initial=0.0) > 1e-6:
        raise SysidError(
            f"{setup.file}: an equality constraint holds the joint '{setup.joint}', so it is not passive. Switch it off "
            '(active="false"), as it was in the measurement.'
        )


def _loops(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, Array]:
    """Return Jacobian, shape (e, nv), and error, shape (e,), of the active equality constraints."""
    data.qvel[:] = 0.0
    given, model.opt.jacobian = model.opt.jacobian, mujoco.mjtJacobian.mjJAC_DENSE
    mujoco.mj_forward(model, data)
    model.opt.jacobian = given
    rows = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    jacobian = np.array(data.efc_J).reshape(data.nefc, model.nv) if data.nefc else np.zeros((0, model.nv))
    return jacobian[rows] if data.nefc else jacobian, np.array(data.efc_pos)[rows]


def tied_to(model: mujoco.MjModel, data: mujoco.MjData, own: int) -> set[int]:
    """Return the other velocities that loops tie to one, directly or through others."""
    touched = np.abs(_loops(model, data)[0]) > CLOSED
    found, before = {own}, 0
    while len(found) > before:
        before = len(found)
        rows = touched[:, sorted(found)].any(axis=1)
        found |= set(np.flatnonzero(touched[rows].any(axis=0)).tolist())
    return found - {own}


def close(model: mujoco.MjModel, data: mujoco.MjData, movable: Sequence[int]) -> bool:
    """Move the given velocities until the loops are closed; return False if they cannot be closed."""
    for _ in range(30):
        jacobian, error = _loops(model, data)
        inside = np.abs(jacobian[:, movable]).sum(axis=1) > CLOSED
        if not np.any(np.abs(error[inside]) > CLOSED):
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
) -> tuple[float, float, float, float, float]:
    """Return inertia, weight, springs' torque, damping and dry friction at the model's position."""
    tangent, mass = tangent_of(model, data, own, movable)
    weight = tangent @ (data.qfrc_gravcomp - data.qfrc_bias)
    springs = tangent @ data.qfrc_spring
    friction = np.abs(tangent) @ model.dof_frictionloss
    slow = 1e-6  # [rad/s]: quadratic damping does not count
    data.qvel[:] = slow * tangent
    mujoco.mj_forward(model, data)
    damping = -tangent @ (data.qfrc_damper + data.qfrc_fluid) / slow
    friction += np.abs(data.ten_velocity / slow) @ model.tendon_frictionloss
    return float(tangent @ mass @ tangent), float(weight), float(springs), float(damping), float(friction)


def _step(model: mujoco.MjModel, data: mujoco.MjData, own: int, movable: Sequence[int], by: float) -> bool:
    """Move the joint with its loops; return False where a loop or a limit ends the way."""
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
