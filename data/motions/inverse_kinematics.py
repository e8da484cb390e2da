# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""Whole-body inverse kinematics: damped least squares over frame, centre-of-mass and posture tasks.

For the generators of poses and motions; nothing of it runs with a policy.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array

FREE = 6
"""Degrees of freedom of the pelvis."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTask:
    """Holds a body's frame at a position and an orientation."""

    body: str
    position: Array | None = None
    """[m], shape (3,); None leaves it free."""
    rotation: Array | None = None
    """Rotation matrix, shape (3, 3); None leaves it free."""
    weight: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Weight of each axis of the position [1/m]."""
    rotation_weight: float = 0.3
    """Weight of the orientation [1/rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BalanceTask:
    """Holds the centre of mass above a point of the ground."""

    position: Array
    """[m], shape (2,)."""
    weight: float = 1.0
    """[1/m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PostureTask:
    """Pulls joints towards angles, each with its own weight; it settles what the others leave open."""

    joints: Array
    """[rad], shape (nq - 7,)."""
    weight: Array
    """[1/rad], shape (nq - 7,)."""


Task = FrameTask | BalanceTask | PostureTask


def solve(
    model: mujoco.MjModel,
    start: Array,
    tasks: Sequence[Task],
    *,
    margin: float = 0.02,
    tolerance: float = 1e-6,
    steps: int = 300,
) -> Array:
    """Return the configuration that meets the tasks best in the sense of weighted least squares.

    Levenberg-Marquardt in the tangent space of the free joint; joints that would pass their limits are
    held there (active set).

    Args:
        model: A free joint followed by hinges.
        start: Configuration to start from, shape (nq,).
        tasks: What to hold.
        margin: Distance kept from every joint limit [rad].
        tolerance: A step shorter than this [m or rad], or a relative gain smaller than this, ends the search.
        steps: Most steps allowed.

    Returns:
        Configuration, shape (nq,).

    Raises:
        SysidError: The search did not settle.
    """
    data = mujoco.MjData(model)
    low = model.jnt_range[1:, 0] + margin
    high = model.jnt_range[1:, 1] - margin
    qpos = start.copy()
    qpos[7:] = np.clip(qpos[7:], low, high)
    residual, jacobian = _linearise(model, data, qpos, tasks)
    damping, step = 1e-6, np.full(model.nv, np.inf)
    for _ in range(steps):
        step = _step(residual, jacobian, damping, qpos[7:], low, high)
        trial = qpos.copy()
        mujoco.mj_integratePos(model, trial, step, 1.0)
        trial[7:] = np.clip(trial[7:], low, high)
        new_residual, new_jacobian = _linearise(model, data, trial, tasks)
        before, after = float(residual @ residual), float(new_residual @ new_residual)
        if after > before * (1 + 1e-12):
            damping = max(damping, 1e-6) * 10  # too far for the linear model
        else:
            qpos, residual, jacobian = trial, new_residual, new_jacobian
            damping /= 3
            if before - after < tolerance * after:  # along a stretched limb the steps shrink slowly
                return qpos
        if np.abs(step).max() < tolerance:
            return qpos
    raise SysidError(
        f"inverse kinematics did not settle in {steps} steps (last step {np.abs(step).max():.2g}). "
        "The constraints contradict each other or lie out of reach."
    )


def _step(residual: Array, jacobian: Array, damping: float, joints: Array, low: Array, high: Array) -> Array:
    """Return the damped least-squares step, shape (nv,), of the joints that are not held at a limit."""
    free = np.ones(jacobian.shape[1], dtype=bool)
    while True:  # joints are held one set after another, so at most nv times
        step = np.zeros(len(free))
        part = jacobian[:, free]
        step[free] = np.linalg.solve(part.T @ part + damping * np.eye(part.shape[1]), -part.T @ residual)
        held = (np.isclose(joints, low) & (step[FREE:] < 0)) | (np.isclose(joints, high) & (step[FREE:] > 0))
        if not np.any(held):
            return step
        free[FREE:] &= ~held


def _linearise(
    model: mujoco.MjModel, data: mujoco.MjData, qpos: Array, tasks: Sequence[Task]
) -> tuple[Array, Array]:
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    rows = [_task_rows(model, data, task) for task in tasks]
    return np.concatenate([row[0] for row in rows]), np.vstack([row[1] for row in rows])


def _task_rows(model: mujoco.MjModel, data: mujoco.MjData, task: Task) -> tuple[Array, Array]:
    if isinstance(task, PostureTask):
        jacobian = np.hstack([np.zeros((len(task.weight), FREE)), np.diag(task.weight)])
        return task.weight * (data.qpos[7:] - task.joints), jacobian
    if isinstance(task, BalanceTask):
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacSubtreeCom(model, data, jacobian, 1)
        error = data.subtree_com[1, :2] - task.position
        return task.weight * error, task.weight * jacobian[:2]
    return _frame_rows(model, data, task)


def _frame_rows(model: mujoco.MjModel, data: mujoco.MjData, task: FrameTask) -> tuple[Array, Array]:
    body = model.body(task.body).id
    position, rotation = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacBody(model, data, position, rotation, body)
    residuals: list[Array] = []
    jacobians: list[Array] = []
    if task.position is not None:
        weight = np.array(task.weight)
        residuals.append(weight * (data.xpos[body] - task.position))
        jacobians.append(weight[:, None] * position)
    if task.rotation is not None:
        error = rotation_vector(data.xmat[body].reshape(3, 3) @ task.rotation.T)
        residuals.append(task.rotation_weight * error)
        jacobians.append(task.rotation_weight * rotation)
    return np.concatenate(residuals), np.vstack(jacobians)


def rotation_vector(rotation: Array) -> Array:
    """Return the rotation vector [rad], shape (3,), of a rotation matrix, shape (3, 3)."""
    quaternion, vector = np.zeros(4), np.zeros(3)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).reshape(9))
    mujoco.mju_quat2Vel(vector, quaternion, 1.0)
    return vector


def rotation_matrix(*, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Array:
    """Return Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3); angles in rad."""
    (cy, cp, cr), (sy, sp, sr) = np.cos([yaw, pitch, roll]), np.sin([yaw, pitch, roll])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return about_z @ about_y @ about_x
