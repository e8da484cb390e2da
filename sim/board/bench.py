"""The clamped bench: the deck on its tilt joint and nothing else, released and left to swing."""

import math
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np

from sim.board.bodies import TILT_JOINT, add_body, deck_inertia, inertia_ratio, law_of
from sim.board.learned import apply, left_out
from sim.board.scene import add_effects, integrator_value, roll_inertia
from sysid.board import Board
from sysid.errors import SysidError
from sysid.quantity import GRAVITY
from sysid.roll import Array

AfterStep = Callable[[mujoco.MjModel, mujoco.MjData], None]
"""Called after each step, e.g. to set the trucks of a scene whose coupling is 'direct'."""
Begin = Callable[[mujoco.MjModel, mujoco.MjData, float, float], None]
"""Sets a model to a position [rad or m] and a rate of its joint."""


def rig_spec(board: Board, *, timestep: float = 0.001, integrator: str = "implicitfast") -> mujoco.MjSpec:
    """Build the bench from a board record: base clamped, deck free to tilt without a limit.

    Args:
        board: The record; its deck mass, roll inertia, stiffness, damping and effects are built.
        timestep: [s].

    Raises:
        SysidError: The record cannot be built, or compiled mass or inertia differ from the record.
    """
    spec = mujoco.MjSpec()
    spec.modelname = f"{board.name}_bench"
    spec.compiler.degree = False
    spec.option.timestep = timestep
    spec.option.integrator = integrator_value(integrator)
    spec.worldbody.add_light(pos=[0.0, -1.0, 1.5], dir=[0.0, 0.6, -1.0])
    mass, inertia, size = _deck(board)
    height = board.geometry["truck_height"].value if board.geometry else 2 * size[1]
    deck = add_body(spec.worldbody, "deck", (0.0, 0.0, height), mass, inertia)
    joint = deck.add_joint(
        name=TILT_JOINT, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1.0, 0.0, 0.0],
        limited=mujoco.mjtLimited.mjLIMITED_FALSE,
    )  # fmt: skip
    deck.add_geom(
        name="deck_visual", type=mujoco.mjtGeom.mjGEOM_BOX, size=size, contype=0, conaffinity=0,
        rgba=[0.83, 0.68, 0.47, 1.0],
    )  # fmt: skip
    add_effects(spec, joint, board)
    _assert_matches_record(spec, board, mass)
    return spec


def _deck(board: Board) -> tuple[float, Array, Array]:
    """Return mass [kg], principal inertia [kg*m^2], shape (3,), and half sides [m], shape (3,), of the tilting body.

    A record without geometry gets a cube of its inertia, heavy enough to hold the moment of the weight inside it.
    """
    roll = board.inertia.value
    if board.geometry and board.mass:
        sides = np.array([board.geometry[key].value for key in ("length", "width", "thickness")])
        return board.mass["deck"].value, deck_inertia(board, roll), sides / 2
    moment = max(law_of(board).stiffness_of_effects, 0.0)
    mass = max(roll / 0.01, 2 * moment**2 / (GRAVITY.value**2 * roll))
    return mass, np.full(3, roll), np.full(3, math.sqrt(1.5 * roll / mass))


def _assert_matches_record(spec: mujoco.MjSpec, board: Board, mass: float) -> None:
    model = spec.compile()
    ratio = inertia_ratio(board)
    if not math.isclose(roll_inertia(model), ratio * board.inertia.value, rel_tol=1e-6):
        raise SysidError(
            f"board '{board.name}': the compiled roll inertia is {roll_inertia(model):.6g} kg*m^2, the record "
            f"says {ratio * board.inertia.value:.6g} kg*m^2."
        )
    if not math.isclose(model.body("deck").mass[0], mass, rel_tol=1e-9):
        raise SysidError(
            f"board '{board.name}': the compiled deck weighs {model.body('deck').mass[0]:.6g} kg, the record "
            f"says {mass:.6g} kg."
        )


@dataclass(frozen=True, slots=True)
class Swing:
    """A release simulated in MuJoCo, at its own steps."""

    time: Array
    """Time since the release [s], shape (n,)."""
    roll: Array
    """Roll of the deck [rad], shape (n,)."""

    def at(self, time: Array) -> Array:
        """Return the roll [rad] at other times [s], by a cubic spline through the steps."""
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.time, self.roll)(time)


def swing(
    model: mujoco.MjModel, angle: float, rate: float, duration: float, *, joint: str = TILT_JOINT,
    after_step: AfterStep | None = None, begin: Begin | None = None,
) -> Swing:  # fmt: skip
    """Release the deck and step MuJoCo.

    Args:
        model: Compiled bench or scene, in the configuration from which the deck is released.
        angle: Roll at release [rad].
        rate: Roll rate at release [rad/s].
        duration: At least this long is simulated [s].
        joint: Name of the tilt joint; its axis may be +x or -x.
        begin: Sets the model to its start; `angle` is then the joint's own position.

    Raises:
        SysidError: The simulation becomes unstable.
    """
    data = mujoco.MjData(model)
    where = model.joint(joint)
    sign = 1.0 if begin is not None or where.axis[0] > 0 else -1.0
    q, v = int(where.qposadr[0]), int(where.dofadr[0])
    if begin is None:
        data.qpos[q], data.qvel[v] = sign * angle, sign * rate
        steer_to_tilt(model, data, q, v)
    else:
        begin(model, data, angle, rate)
    _drag(model, data, joint)
    if after_step is not None:
        after_step(model, data)
    left = left_out(model)
    steps = math.ceil(duration / model.opt.timestep) + 2
    roll = np.empty(steps + 1)
    roll[0] = angle
    with stable(model, data):
        for i in range(steps):
            apply(left, data)
            mujoco.mj_step(model, data)
            if after_step is not None:
                after_step(model, data)
            roll[i + 1] = sign * data.qpos[q]
    return Swing(model.opt.timestep * np.arange(steps + 1), roll)


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
