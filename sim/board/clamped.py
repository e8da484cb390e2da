"""A scene whose chassis is held: its joint is released and left to swing in MuJoCo."""

import math
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np

from sim.board.bodies import TILT_JOINT
from sim.board.learned import apply, left_out
from sysid.errors import SysidError
from sysid.roll import Array

AfterStep = Callable[[mujoco.MjModel, mujoco.MjData], None]
"""Called after each step, e.g. to set the trucks of a scene whose coupling is 'direct'."""
Begin = Callable[[mujoco.MjModel, mujoco.MjData, float, float], None]
"""Sets a model to a position [rad or m] and a rate of its joint."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClampedScene:
    """A compiled scene with its chassis held, ready for a release."""

    model: mujoco.MjModel
    """In the configuration from which the joint is released."""
    name: str = ""
    """In words, for the record and the report."""
    joint: str = TILT_JOINT
    """Its axis may be +x or -x."""
    after_step: AfterStep | None = None
    begin: Begin | None = None
    """Sets a robot's model to a release. Its limits then act in MuJoCo and do not end the compared decay."""

    @property
    def tilt_range(self) -> float:
        """Largest tilt that the joint allows to both sides [rad]; infinite without a limit."""
        joint = self.model.joint(self.joint)
        if self.begin is not None or not self.model.jnt_limited[joint.id]:
            return math.inf
        return float(min(abs(joint.range[0]), abs(joint.range[1])))

    @property
    def sign(self) -> float:
        """Sign of the joint's position when its right edge is down; a robot's angles are its own."""
        return 1.0 if self.begin is not None or self.model.joint(self.joint).axis[0] > 0 else -1.0

    def step(self, data: mujoco.MjData) -> None:
        """Move the scene by one step."""
        mujoco.mj_step(self.model, data)
        if self.after_step is not None:
            self.after_step(self.model, data)

    def swing(self, angle: float, rate: float, duration: float) -> tuple[Array, Array]:
        """Release the joint at an angle [rad] and a rate [rad/s], and step MuJoCo for at least a duration [s].

        Returns:
            Times of MuJoCo's steps since the release [s] and roll of the deck there [rad], shape (n,) each.

        Raises:
            SysidError: The simulation becomes unstable.
        """
        model, data = self.model, mujoco.MjData(self.model)
        where = model.joint(self.joint)
        q, v = int(where.qposadr[0]), int(where.dofadr[0])
        if self.begin is None:
            data.qpos[q], data.qvel[v] = self.sign * angle, self.sign * rate
            steer_to_tilt(model, data, q, v)
        else:
            self.begin(model, data, angle, rate)
        _drag(model, data, self.joint)
        if self.after_step is not None:
            self.after_step(model, data)
        left = left_out(model)
        steps = math.ceil(duration / model.opt.timestep) + 2
        roll = np.empty(steps + 1)
        roll[0] = angle
        with stable(model, data):
            for i in range(steps):
                apply(left, data)
                self.step(data)
                roll[i + 1] = self.sign * data.qpos[q]
        return model.opt.timestep * np.arange(steps + 1), roll


@contextmanager
def stable(model: mujoco.MjModel, data: mujoco.MjData) -> Generator[None]:
    """Raise an error if the simulation in this block becomes unstable; MuJoCo alone would write a log file.

    Raises:
        SysidError: A position, rate or acceleration is not finite, or huge.
    """
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
    kinds = mujoco.mjtWarning
    if any(
        data.warning[int(k)].number
        for k in (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
    ):
        raise SysidError(
            f"the simulation is unstable at a step of {model.opt.timestep:g} s. Choose a smaller --timestep, or check the "
            "signs and sizes of the record's effects."
        )


def steer_to_tilt(model: mujoco.MjModel, data: mujoco.MjData, q: int, v: int) -> None:
    """Move joints that equality constraints tie to the tilt joint to its position, in place.

    A release would otherwise start with a violated constraint and its kick.
    """
    tilt = next(i for i in range(model.njnt) if model.jnt_qposadr[i] == q)
    for i in range(model.neq):
        if model.eq_type[i] != mujoco.mjtEq.mjEQ_JOINT or not model.eq_active0[i]:
            continue
        polynomial = np.polynomial.Polynomial(model.eq_data[i, :5])
        first, second = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
        if second == tilt:
            data.qpos[model.jnt_qposadr[first]] = polynomial(data.qpos[q])
            data.qvel[model.jnt_dofadr[first]] = polynomial.deriv()(data.qpos[q]) * data.qvel[v]
        elif first == tilt and polynomial.coef[1] != 0:
            angle = (data.qpos[q] - polynomial.coef[0]) / polynomial.coef[1]
            data.qpos[model.jnt_qposadr[second]] = angle
            data.qvel[model.jnt_dofadr[second]] = data.qvel[v] / polynomial.coef[1]


def _drag(model: mujoco.MjModel, data: mujoco.MjData, joint: str) -> None:
    """Set support, slider and bristles to their states after a slow pull from rest to the release."""
    kinds, own = mujoco.mjtObj, model.joint(joint).qposadr[0]
    hanging = mujoco.mj_name2id(model, kinds.mjOBJ_JOINT, f"{joint}_hanging_joint")
    if hanging >= 0:  # the hanging body is at rest; its joint counts from the deck
        data.qvel[model.jnt_dofadr[hanging]] = -data.qvel[model.joint(joint).dofadr[0]]
    tilt = float(data.qpos[own] - model.qpos_spring[own])
    for name in ("support", "slider"):
        body = mujoco.mj_name2id(model, kinds.mjOBJ_JOINT, f"{joint}_{name}_joint")
        if body < 0:
            continue
        tendon = mujoco.mj_name2id(model, kinds.mjOBJ_TENDON, f"{joint}_on_{name}")
        pull, spring = float(model.tendon_stiffness[tendon]), float(model.jnt_stiffness[body])
        reach = float(model.tendon_frictionloss[tendon]) / spring
        held = pull / (pull + spring) * tilt if name == "support" else min(max(tilt, -reach), reach)
        data.qpos[model.jnt_qposadr[body]] = held
    for motor, address in enumerate(model.actuator_actadr):
        bristles = float(model.actuator_dynprm[motor, 5])
        electric = model.actuator_dyntype[motor] == mujoco.mjtDyn.mjDYN_DCMOTOR
        if electric and bristles > 0 and model.actuator_trnid[motor, 0] == model.joint(joint).id:
            reach = float(model.actuator_biasprm[motor, 4]) / bristles
            data.act[address] = math.copysign(-reach * math.expm1(-abs(tilt) / reach), tilt)
