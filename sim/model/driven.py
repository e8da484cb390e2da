"""A driven joint of a model: its load along a log, its replay in plain MuJoCo, and a patched file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Self

import mujoco
import numpy as np

from sim.model.patch import Patch, Writer, patched
from sim.model.scene import HOLDING_ARMATURE
from sim.model.setup import Setup, switch_off
from sysid.driven.fit import DrivenFit
from sysid.driven.joint import Simulator, Structure
from sysid.driven.log import DrivenLog, InputKind, Load
from sysid.driven.motion import Motion
from sysid.effects import catalogue, drives
from sysid.effects._base import DriveEffect
from sysid.effects._mjcf import actuators_of
from sysid.errors import SysidError
from sysid.quantity import Z95
from sysid.roll import Array

TURN = 1e-4
"""Turn of a joint over which the slope of its load is taken [rad or m]."""


@dataclass(frozen=True, slots=True)
class Stated:
    """A model's facts about a driven joint."""

    structure: Structure
    values: Mapping[str, float]
    note: str
    """Its actuator, in words."""
    simulator: Simulator


def stated(
    setup: Setup, kind: InputKind, gains: Sequence[float] = (), encoder: Literal["joint", "motor"] = "joint"
) -> Stated:
    """Return the effects and numbers of a joint and its actuator in a model.

    Args:
        gains: Of the controller instead of the model's: kp and kd of a command, else the torque of one unit; in SI.
        encoder: Side of the gear that it measures.

    Raises:
        SysidError: The model cannot be read.
    """
    spec = setup.load()
    joint = setup.joint_of(spec)
    model = spec.compile()
    number = model.joint(setup.joint)
    dof, where = int(number.dofadr[0]), int(number.qposadr[0])
    values = {
        "armature": float(model.dof_armature[dof]), "damping": float(model.dof_damping[dof]),
        "stiffness": float(model.jnt_stiffness[number.id]), "rest_angle": float(model.qpos_spring[where]),
    }  # fmt: skip
    effects: list[str] = []
    for part in catalogue().values():
        if (found := part.from_mjcf(joint)) and part.role == "torque":
            effects.append(part.name)
            values |= {f"{part.name}.{p}": v for p, v in zip(part.parameter_names, found, strict=True)}
    source = Structure(kind).source
    acting = next(iter(actuators_of(spec, joint)), None)
    read = gains or (() if acting is None else _gains(acting, kind))
    if kind == "command" and not read:
        has = f"actuator '{acting.name}' of joint" if acting else "no actuator on joint"
        raise SysidError(
            f"{has} '{setup.joint}' follows commands: it has no position gains. Give those of the controller with --gains KP KD, "
            "or say what the column is: --input-is torque, force, current or voltage."
        )
    values |= {f"{source.name}.{p.name}": v for p, v in zip(source.parameters, read, strict=False)}
    if acting is not None:
        limit = float(acting.forcerange[1]) if model.actuator_forcelimited[acting.id] else 0.0
        numbers = ((limit, "saturation"), (float(getattr(acting, "delay", 0.0)), "delay"))
        for value, family in numbers:
            part = next(one for one in drives().values() if one.family == family)
            if value > 0:
                effects.append(part.name)
                values[f"{part.name}.{part.parameters[0].name}"] = value
    note = "no actuator in the model: the input acts on the joint itself"
    if acting is not None:
        note = f"actuator '{acting.name}'" if acting.name else "an actuator without a name"
    followed = acting is not None and kind == "command" and not gains
    return Stated(
        Structure(kind, tuple(sorted(effects)), encoder),
        values,
        note,
        _simulator(model, dof, followed=followed),
    )


def _simulator(model: Any, dof: int, *, followed: bool) -> Simulator:
    """Return how MuJoCo moves a degree of freedom; `followed` says that an actuator of the model is its servo."""
    limits, (time, ratio) = model.dof_solimp[dof], model.dof_solref[dof]
    step, bits = float(model.opt.timestep), mujoco.mjtDisableBit
    if time > 0 and not model.opt.disableflags & bits.mjDSBL_REFSAFE:
        time = max(time, 2 * step)
    kinds = mujoco.mjtIntegrator
    implicit: Literal["nothing", "joint", "actuator"] = "joint"
    if model.opt.integrator == kinds.mjINT_RK4:
        implicit = "nothing"
    elif followed and model.opt.integrator != kinds.mjINT_EULER:
        implicit = "actuator"
    return Simulator(
        step=step,
        implicit=implicit,
        rate=float(2 / (limits[1] * time) if time > 0 else -ratio / limits[1]),
        softness=float(1 / limits[0] - 1),
        alone=float(1 / model.dof_invweight0[dof] - model.dof_armature[dof]),
    )


def free_inertia(setup: Setup, armatures: Mapping[str, float]) -> float:
    """Return the inertia of a joint at qpos0 with all others free, without its own armature [kg*m^2].

    Args:
        armatures: Of joints, in place of the model's [kg*m^2].
    """
    model = setup.load().compile()
    for name, armature in armatures.items():
        model.dof_armature[int(model.joint(name).dofadr[0])] = armature
    mujoco.mj_setConst(model, mujoco.MjData(model))
    dof = int(model.joint(setup.joint).dofadr[0])
    return float(1 / model.dof_invweight0[dof] - model.dof_armature[dof])


def _gains(actuator: Any, kind: InputKind) -> tuple[float, ...]:
    """Return kp and kd of a position servo, or the torque for one unit of a motor [SI]; empty for other actuators."""
    gear = float(actuator.gear[0])
    if kind == "command":
        return (
            (float(actuator.gainprm[0]) * gear, -float(actuator.biasprm[2]) * gear)
            if actuator.biasprm[1] and gear == 1
            else ()
        )
    return () if kind in ("torque", "force") else (float(actuator.gainprm[0]) * gear,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """A joint's motion, shape (n,) each, and its part in the motion of the others."""

    angle: Array
    """[rad or m]."""
    rate: Array
    """[rad/s]."""
    acceleration: Array
    """[rad/s^2]."""
    armature: float | None = None
    """[kg*m^2]; the model's if left out."""
    damping: float = 0.0
    """Damping that a simulator takes at the end of its step [N*m*s/rad]."""

    @classmethod
    def measured(cls, time: Array, angle: Array, at: Array | None = None) -> Self:
        """Return the course of measured angles [rad or m] at times [s], shape (n,) each, or at other times, shape (m,)."""
        smooth, at = Motion(time, angle), time if at is None else at
        rate, acceleration = (np.interp(at, smooth.time, x) for x in (smooth.rate, smooth.acceleration))
        return cls(angle=np.interp(at, time, angle), rate=rate, acceleration=acceleration)


def load_along(setup: Setup, courses: Mapping[str, Course], time: Array | None = None) -> Load:
    """Return the load that the rest of a model puts on a joint along a log.

    The torque is minus that of `mj_inverse` without an acceleration of the joint itself. The other joints move along their
    courses, or are held in the pose of the setup. Contacts, limits and loops are off.

    Args:
        time: Of the courses [s], shape (n,); the log's if left out.
    """
    model, data, pose = _inverse_of(setup)
    dof, where = int(model.joint(setup.joint).dofadr[0]), int(model.joint(setup.joint).qposadr[0])
    numbers = [setup.named(model, name) for name in courses if name != setup.joint]
    places, addresses = model.jnt_dofadr[numbers], model.jnt_qposadr[numbers]
    others, own = [one for name, one in courses.items() if name != setup.joint], courses[setup.joint]
    for place, one in zip(places, others, strict=True):
        if one.armature is not None:
            model.dof_armature[place] = one.armature
    states = np.array([[one.angle, one.rate, one.acceleration] for one in others])
    states = states.reshape(len(others), 3, len(own.angle))
    damping = np.array([one.damping for one in others])
    stepped = own.damping > 0 or damping.any()  # else the others' inertia is not needed
    mass, rows = np.zeros((model.nv, model.nv)), np.zeros((6, len(own.angle)))
    data.qpos[:] = pose
    for i in range(len(own.angle)):
        data.qpos[addresses], data.qvel[places] = states[:, 0, i], states[:, 1, i]
        data.qvel[dof] = own.rate[i]
        for turn in (TURN, -TURN, 0.0):
            data.qacc[:] = 0.0
            data.qacc[places], data.qpos[where] = states[:, 2, i], own.angle[i] + turn
            mujoco.mj_inverse(model, data)
            torque = -float(data.qfrc_inverse[dof])
            rows[2, i] += np.sign(turn) * torque / (2 * TURN)
        mujoco.mj_fullM(model, data, mass)
        inertia = mass[dof, dof] - model.dof_armature[dof]
        rows[:2, i], rows[3:5, i] = (inertia, torque), (own.angle[i], inertia)
        if stepped:
            gives = np.linalg.solve(mass[np.ix_(places, places)], mass[places, dof])
            rows[4:, i] = inertia - gives @ mass[places, dof], gives @ (damping * data.qacc[places])
    return Load.of(rows, time)


def coupling_along(setup: Setup, courses: Mapping[str, Course]) -> Array:
    """Return derivatives of each joint's load by angle, rate and acceleration of each joint in SI, shape (joints, joints, 3, n)."""
    model, data, pose = _inverse_of(setup)
    numbers = [setup.named(model, name) for name in courses]
    places, addresses = model.jnt_dofadr[numbers], model.jnt_qposadr[numbers]
    states = np.array([[one.angle, one.rate, one.acceleration] for one in courses.values()])
    found = np.zeros((len(states), *states.shape))
    data.qpos[:] = pose

    def torques(state: Array) -> Array:
        data.qpos[addresses], data.qvel[places], data.qacc[places] = state.T
        mujoco.mj_inverse(model, data)
        return -data.qfrc_inverse[places]

    for i in range(states.shape[2]):
        plain = torques(states[:, :, i])
        for other, kind in np.ndindex(states.shape[:2]):
            moved = states[:, :, i].copy()
            moved[other, kind] += TURN
            found[:, other, kind, i] = (torques(moved) - plain) / TURN
    return found


def _inverse_of(setup: Setup) -> tuple[Any, Any, Array]:
    """Return a model for inverse dynamics without contacts, limits and loops, its data and the pose of the setup in SI, shape (q,)."""
    spec = setup.load()
    for joint in spec.joints:
        joint.stiffness, joint.damping, joint.frictionloss = [0.0] * 3, [0.0] * 3, 0.0
    switch_off(spec.option, "CONTACT", "LIMIT", "FRICTIONLOSS", "ACTUATION", "EQUALITY")
    model = spec.compile()
    return model, mujoco.MjData(model), setup.posed(model)


def replay(setup: Setup, logs: Mapping[str, DrivenLog], values: Mapping[str, Stated]) -> dict[str, Array]:
    """Return the angles of a model that gets the inputs of logs, at their samples, shape (n,) each [rad or m].

    Plain MuJoCo at the model's own step and integrator. A command goes to the joint's position actuator, or through the gains
    of `values` without one. All other inputs are torques on the joint. Other joints move as measured, or are held.

    Args:
        logs: By joint, with one clock.
    """
    spec = setup.load()
    for joint in spec.joints:
        if joint.name not in logs:
            joint.armature = HOLDING_ARMATURE
    switch_off(spec.option, "CONTACT")
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = setup.posed(model)
    step = float(model.opt.timestep)
    first = next(iter(logs.values()))
    grid = np.arange(first.time[0], first.time[-1] + step, step)
    beside = _beside(model, first, grid)
    driven: list[tuple[int, int, int, Array, tuple[float, ...]]] = []
    for name, log in logs.items():
        joint, source = model.joint(name), Structure(log.kind).source
        spread = np.abs(log.time - log.time[0]) <= 5 * log.step
        line = np.polyfit(log.time[spread] - log.time[0], log.angle[spread], 2)
        where, dof = int(joint.qposadr[0]), int(joint.dofadr[0])
        data.qpos[where], data.qvel[dof] = line[-1], line[-2]
        acting = next((one for one in actuators_of(spec, setup.with_(joint=name).joint_of(spec))), None)
        by_model = acting is not None and log.kind == "command" and bool(_gains(acting, log.kind))
        gains = tuple(values[name].values.get(f"{source.name}.{p.name}", 1.0) for p in source.parameters)
        number = acting.id if acting is not None and by_model else -1
        driven.append((where, dof, number, log.mean_input(grid, 0.0)[0], gains))
        if number >= 0 and model.actuator_delay[number] > 0:
            samples = int(model.actuator_history[number, 0])
            mujoco.mj_initCtrlHistory(model, data, number, None, np.full((samples, 1), log.input[0]))
        if number < 0 and acting is not None:
            model.actuator_gainprm[acting.id] = 0.0
            model.actuator_biasprm[acting.id] = 0.0
    paths = np.zeros((len(grid), len(driven)))
    for i in range(len(grid)):
        for where, dof, one in beside:
            data.qpos[where], data.qvel[dof] = one.angle[i], one.rate[i]
            data.qfrc_applied[dof] = HOLDING_ARMATURE * one.acceleration[i]
        paths[i] = data.qpos[[where for where, *_ in driven]]
        for where, dof, number, inputs, gains in driven:
            u = inputs[min(i, len(inputs) - 1)]
            if number >= 0:
                data.ctrl[number] = u
            elif len(gains) == 2:
                data.qfrc_applied[dof] = gains[0] * (u - data.qpos[where]) - gains[1] * data.qvel[dof]
            else:
                data.qfrc_applied[dof] = gains[0] * u
        mujoco.mj_step(model, data)
        if not np.all(np.isfinite(data.qpos)) or data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise SysidError(
                f"{setup.file}: the replay runs away at {grid[i]:.4g} s. Check unit and sign of the input, and the gains."
            )
    return {name: np.interp(log.time, grid, paths[:, i]) for i, (name, log) in enumerate(logs.items())}


def _beside(model: Any, log: DrivenLog, grid: Array) -> list[tuple[int, int, Course]]:
    """Return address in qpos, address in qvel and course of each joint that moves as measured, at times [s], shape (n,)."""
    return [
        (int(model.joint(name).qposadr[0]), int(model.joint(name).dofadr[0]), Course.measured(log.time, angle, grid))
        for name, angle in log.beside.items()
    ]  # fmt: skip


def patch_driven(setup: Setup, fits: Mapping[str, DrivenFit]) -> Patch:
    """Write fitted driven joints and their actuators into the text of a model.

    Raises:
        SysidError: A joint is not in the text, or MuJoCo cannot hold an effect there.
    """

    def writer(fit: DrivenFit) -> Writer:
        return lambda spec, joint: [f"{joint.name}: {line}" for line in _written(spec, joint, fit)]

    return patched(setup.with_(payload=()), {name: writer(fit) for name, fit in fits.items()})


def _written(spec: Any, joint: Any, fit: DrivenFit) -> list[str]:
    """Write a fitted joint into a spec; return remarks on it."""
    joint.armature, joint.frictionloss = fit.values["armature"], 0.0
    joint.damping = [fit.values["damping"], 0.0, 0.0]
    remarks: list[str] = []
    constraint = joint.solref_friction.copy(), joint.solimp_friction.copy()
    for part in fit.structure.parts:
        if any(key.startswith(f"{part.name}.") for key in fit.quantities):
            own = {p.name: fit.values[f"{part.name}.{p.name}"] for p in part.parameters}
            said = part.to_mjcf(spec, joint, own, native=True)
            softened = fit.structure.simulator is not None and getattr(part, "friction", None) is not None
            if softened:  # its friction is that of the log
                joint.solref_friction, joint.solimp_friction = constraint
                said = (
                    f"{part.name}: frictionloss {joint.frictionloss:.4g}; solref and solimp stay, as the log moves like MuJoCo",
                )
            remarks += [line for line in said if not isinstance(part, DriveEffect) or "not written" in line]
    remarks += [
        f"{key} {fit.quantities[key]} is not written: MuJoCo has no attribute for it"
        for key in ("bias", "zero")
        if key in fit.quantities and abs(fit.values[key]) > Z95 * fit.quantities[key].std
    ]
    return remarks
