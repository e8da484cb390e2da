"""A driven joint of a model: its load along a log, its replay in plain MuJoCo, and a patched file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np

from sim.model.patch import (
    ATTRIBUTES,
    Patch,
    attribute_text,
    difference,
    find_element,
    is_joint,
    tagged,
    with_sections,
)
from sim.model.scene import HOLDING_ARMATURE
from sim.model.setup import Setup
from sysid.driven.fit import DrivenFit
from sysid.driven.joint import Simulator, Structure
from sysid.driven.log import DrivenLog, InputKind, Load
from sysid.driven.missing import Motion
from sysid.effects import catalogue, drives
from sysid.effects._base import DriveEffect
from sysid.effects._mjcf import actuators_of
from sysid.errors import SysidError
from sysid.roll import Array

TURN = 1e-4
"""Turn of a joint over which the slope of its load is taken [rad or m]."""


@dataclass(frozen=True, slots=True)
class Stated:
    """A model's facts about a driven joint."""

    structure: Structure
    values: Mapping[str, float]
    notes: tuple[str, ...]
    simulator: Simulator


def stated(setup: Setup, kind: InputKind, gains: Sequence[float] = ()) -> Stated:
    """Return the effects and numbers of a joint and its actuator in a model.

    Args:
        gains: Of the controller instead of the model's: kp and kd of a command, else the torque of one unit; in SI.

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
    values |= {f"{source.name}.{p.name}": v for p, v in zip(source.parameters, read, strict=False)}
    if acting is not None:
        limit = float(acting.forcerange[1]) if model.actuator_forcelimited[acting.id] else 0.0
        numbers = ((limit, "saturation"), (float(getattr(acting, "delay", 0.0)), "delay"))
        for value, family in numbers:
            part = next(one for one in drives().values() if one.family == family)
            if value > 0:
                effects.append(part.name)
                values[f"{part.name}.{part.parameters[0].name}"] = value
    notes = (
        f"actuator '{acting.name}'"
        if acting
        else "no actuator in the model: the input acts on the joint itself",
    )
    followed = acting is not None and kind == "command" and not gains
    return Stated(
        Structure(kind, tuple(sorted(effects))), values, notes, _simulator(model, dof, followed=followed)
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


def load_along(
    setup: Setup, motion: Mapping[str, Array], time: Array, *, simulated: bool = False, lag: float = 0.0
) -> Load:
    """Return the load that the rest of a model puts on a joint along a log.

    The torque is minus that of `mj_inverse` without an acceleration of the joint itself. The other joints move as measured, or
    are held in the pose of the setup. Contacts, limits and loops are off.

    Args:
        motion: Measured angles of joints [rad or m], shape (n,) each.
        time: Of the samples [s], shape (n,).
        simulated: Whether they are from a simulation, without noise.
        lag: Of its rates behind its angles [s]: half a step of MuJoCo's Euler.
    """
    from scipy.interpolate import CubicSpline

    spec = setup.load()
    joint = setup.joint_of(spec)
    joint.stiffness, joint.damping, joint.frictionloss, own = [0.0] * 3, [0.0] * 3, 0.0, float(joint.armature)
    bits = mujoco.mjtDisableBit
    spec.option.disableflags |= int(
        bits.mjDSBL_CONTACT
        | bits.mjDSBL_LIMIT
        | bits.mjDSBL_FRICTIONLOSS
        | bits.mjDSBL_ACTUATION
        | bits.mjDSBL_EQUALITY
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    pose = setup.posed(model)
    dof, where = int(model.joint(setup.joint).dofadr[0]), int(model.joint(setup.joint).qposadr[0])
    others: list[tuple[int, int, Array, Array, Array]] = []
    own_rate = np.zeros_like(time)
    for name, angle in motion.items():
        if simulated:
            path = CubicSpline(time, angle)
            rate, acceleration = path(time - lag, 1), path(time, 2)
        else:
            smooth = Motion.of(time, angle)
            rate, acceleration = (np.interp(time, smooth.time, x) for x in (smooth.rate, smooth.acceleration))
        number = setup.named(model, name)
        place, address = int(model.jnt_dofadr[number]), int(model.jnt_qposadr[number])
        if name == setup.joint:
            own_rate = rate
        else:
            others.append((place, address, angle, rate, acceleration))
    angles = motion[setup.joint]
    mass, rows = np.zeros((model.nv, model.nv)), np.zeros((3, len(time)))
    for i in range(len(time)):
        for turn in (TURN, -TURN, 0.0):
            data.qpos[:], data.qvel[:], data.qacc[:] = pose, 0.0, 0.0
            for place, address, values, rate, acceleration in others:
                data.qpos[address], data.qvel[place], data.qacc[place] = values[i], rate[i], acceleration[i]
            data.qpos[where], data.qvel[dof] = angles[i] + turn, own_rate[i]
            mujoco.mj_inverse(model, data)
            torque = -float(data.qfrc_inverse[dof])
            rows[2, i] += np.sign(turn) * torque / (2 * TURN)
        mujoco.mj_fullM(model, data, mass)
        rows[:2, i] = mass[dof, dof] - own, torque
    return Load(inertia=rows[0], torque=rows[1], slope=rows[2], at=angles)


def replay(setup: Setup, logs: Mapping[str, DrivenLog], values: Mapping[str, Stated]) -> dict[str, Array]:
    """Return the angles of a model that gets the inputs of logs, at their samples, shape (n,) each [rad or m].

    Plain MuJoCo at the model's own step and integrator. A command goes to the joint's position actuator, or through the gains
    of `values` without one. All other inputs are torques on the joint. Joints without a log are held.

    Args:
        logs: By joint, with one clock.
        values: By joint: the model's facts.
    """
    spec = setup.load()
    for joint in spec.joints:
        if joint.name not in logs:
            joint.armature = HOLDING_ARMATURE
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = setup.posed(model)
    step = float(model.opt.timestep)
    first = next(iter(logs.values()))
    grid = np.arange(first.time[0], first.time[-1] + step, step)
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


def patch_driven(setup: Setup, fits: Mapping[str, DrivenFit]) -> Patch:
    """Write fitted driven joints and their actuators into the text of a model.

    Raises:
        SysidError: A joint is not in the text, or MuJoCo cannot hold an effect there.
    """
    spec = setup.with_(payload=()).load()
    known = {kind: {one.name for one in getattr(spec, f"{kind}s")} for kind in ("tendon", "actuator")}
    texts: dict[Any, str] = {}
    remarks: list[str] = []
    for name, fit in fits.items():
        one = setup.with_(joint=name, payload=())
        joint = one.joint_of(spec)
        acting = actuators_of(spec, joint)
        before, acted = _numbers(joint, ATTRIBUTES), [_numbers(a, _ACTUATOR) for a in acting]
        joint.armature, joint.damping, joint.frictionloss = (
            fit.values["armature"],
            [fit.values["damping"], 0.0, 0.0],
            0.0,
        )
        remarks += [f"{name}: {line}" for line in _written(spec, joint, fit)]
        _rewrite(
            texts,
            setup,
            name,
            is_joint(name),
            {
                ATTRIBUTES[k]: attribute_text(k, v)
                for k, v in _changed(before, _numbers(joint, ATTRIBUTES)).items()
            },
        )
        for actuator, old in zip(acting, acted, strict=True):
            changes = _changed(old, _numbers(actuator, _ACTUATOR))
            _rewrite(
                texts,
                setup,
                name,
                lambda tag, own, stack, a=actuator: (
                    bool(stack) and stack[-1] == "actuator" and own.get("name") == a.name
                ),
                changes,
            )
    texts.setdefault(setup.file, setup.file.read_bytes().decode())
    texts[setup.file] = with_sections(texts[setup.file], spec, known)
    return Patch(texts, difference(texts), tuple(remarks), spec, setup.file)


def _written(spec: Any, joint: Any, fit: DrivenFit) -> list[str]:
    """Write the fitted effects into a spec; return remarks on them."""
    remarks: list[str] = []
    constraint = joint.solref_friction.copy(), joint.solimp_friction.copy()
    for part in fit.structure.parts:
        if any(key.startswith(f"{part.name}.") for key in fit.quantities):
            own = {p.name: fit.values[f"{part.name}.{p.name}"] for p in part.parameters}
            said = part.to_mjcf(spec, joint, own, native=True)
            remarks += [line for line in said if not isinstance(part, DriveEffect) or "not written" in line]
    if fit.structure.simulator is not None:  # its friction is that of the log
        joint.solref_friction, joint.solimp_friction = constraint
        remarks.append("moves as MuJoCo moves the model: friction keeps its solref and solimp")
    remarks += [
        f"{key} {fit.quantities[key]} is not written: MuJoCo has no attribute for it ({unit})"
        for key, unit in (("bias", "N·m"), ("zero", "rad"))
        if fit.values[key] and key in fit.quantities
    ]
    return remarks


_ACTUATOR = ("gainprm", "biasprm", "forcerange", "delay", "nsample")
"""Attributes of an actuator that a fit may change."""


def _numbers(element: Any, names: Any) -> dict[str, Array]:
    return {
        name: np.array(getattr(element, name), dtype=np.float64) for name in names if hasattr(element, name)
    }


def _changed(old: Mapping[str, Array], new: Mapping[str, Array]) -> dict[str, Array]:
    return {name: value for name, value in new.items() if not np.array_equal(value, old[name])}


def _rewrite(
    texts: dict[Any, str], setup: Setup, joint: str, wanted: Any, changes: Mapping[str, Any]
) -> None:
    """Set attributes of one element in the text of its file."""
    if not changes:
        return
    chain, start, end = find_element(setup.file, joint, wanted, texts=texts)
    for file in chain:
        texts.setdefault(file, file.read_bytes().decode())
    raw = texts[chain[-1]].encode()
    tag = raw[start:end].decode()
    servo = tag.startswith("<position")
    written: dict[str, str] = {}
    for name, value in changes.items():
        if isinstance(value, str):
            written[name] = value
        elif name in ("gainprm", "biasprm") and servo:
            written |= {"kp": f"{value[0]:.7g}"} if name == "gainprm" else {"kv": f"{-value[2]:.7g}"}
        else:
            digits = np.trim_zeros(np.atleast_1d(value), "b")
            written[name] = " ".join(f"{x:.7g}" for x in digits) or "0"
    texts[chain[-1]] = (raw[:start] + tagged(tag, written).encode() + raw[end:]).decode()
