"""Parasitic stiffness, damping and inertia that a scene adds to the tilt joint, by part of the scene.

The scene is a black box. Static loads give its stiffness. A small sampled decay, a recursion of two terms, gives the two
poles of the step. With the stiffness, the poles give damping and inertia as the integrator sees them. Parts are then switched off
one at a time: each change is the part's.
"""

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import mujoco
import numpy as np

from sim.board.clamped import ClampedScene
from sim.board.scene import integrator_name
from sim.compensation.scene import bench_scene, compensate
from sysid.board import Board
from sysid.errors import SysidError
from sysid.joint.sampled import joint_of_map

LOAD = 0.3
"""Static load over the spring's torque at the full tilt [1]. Half or twice as much changes the stiffness by 1e-11 of it."""
POLE_AMPLITUDE = 0.05
"""Amplitude of the decay that gives the poles [rad]. With 0.025 or 0.1 rad, damping and inertia of the shipped boards differ
by 0.16 % at most; the gate names 3 %."""
DECK = "deck alone"


class TiltJoint(NamedTuple):
    """A tilt joint as the integrator sees it."""

    stiffness: float
    """[N*m/rad]."""
    damping: float
    """[N*m*s/rad]."""
    inertia: float
    """[kg*m^2]."""

    @property
    def damping_ratio(self) -> float:
        """ζ = d / 2√(k I)."""
        return self.damping / (2 * math.sqrt(self.stiffness * self.inertia))

    def minus(self, other: "TiltJoint") -> "TiltJoint":
        """Return the difference, quantity by quantity."""
        return TiltJoint(*(own - its for own, its in zip(self, other, strict=True)))


@dataclass(frozen=True, slots=True)
class Parasitics:
    """The tilt joint of the whole scene, the record's, and the contribution of each part."""

    wanted: TiltJoint
    """The joint of the bench, compensated for this integrator and step, measured in the same way."""
    whole: TiltJoint
    parts: tuple[tuple[str, TiltJoint], ...]
    """Contribution of each part while the others stay on; 'deck alone' is the joint without all of them."""
    reach: float
    """Largest tilt that the trucks' limits allow [rad]; infinite without limits."""
    mass: float
    """Of the whole board [kg]."""

    @property
    def deck(self) -> TiltJoint:
        """The deck with everything else switched off."""
        return dict(self.parts)[DECK]


def measure_parasitics(board: Board, scene: ClampedScene) -> Parasitics:
    """Measure the scene's tilt joint with everything on, and with one part off at a time.

    Raises:
        SysidError: The scene does not move, or blows up.
    """
    timestep, integrator = float(scene.model.opt.timestep), integrator_name(scene.model)
    needed = compensate(board, "step-compensated", timestep=timestep, integrator=integrator).board
    wanted = measure(board, bench_scene(needed, timestep=timestep, integrator=integrator))
    whole = measure(board, scene)
    parts: list[tuple[str, TiltJoint]] = []
    for name, switch in _SWITCHES:
        without = copy.copy(scene.model)
        if switch(without, scene.joint):
            parts.append((name, whole.minus(measure(board, replace(scene, model=without)))))
    bare = copy.copy(scene.model)
    for _, switch in _SWITCHES:
        switch(bare, scene.joint)
    parts.append((DECK, measure(board, replace(scene, model=bare, after_step=None))))
    root = scene.model.body_rootid[scene.model.jnt_bodyid[scene.model.joint(scene.joint).id]]
    mass = float(scene.model.body_subtreemass[root])
    return Parasitics(wanted, whole, tuple(parts), _reach(scene), mass)


def measure(board: Board, scene: ClampedScene) -> TiltJoint:
    """Measure stiffness, damping and inertia of a scene's tilt joint from outside.

    Args:
        board: The record; its stiffness and range set the size of load and swing.

    Raises:
        SysidError: The scene does not move, or blows up.
    """
    smooth = copy.copy(scene.model)  # a small decay with dry friction in the tilt joint has no poles
    smooth.dof_frictionloss[smooth.joint(scene.joint).dofadr[0]] = 0.0
    scene = replace(scene, model=smooth, begin=None)
    torque = LOAD * board.stiffness * board.tilt["range"].value
    right, left = _static(scene, torque), _static(scene, -torque)
    tilt, rest = (right - left) / 2, (right + left) / 2
    if not tilt > 0:
        raise SysidError(f"the deck of the scene does not give way to {torque:.3g} N*m.")
    stiffness = torque / tilt
    duration = 3 * math.pi * math.sqrt(board.inertia.value / board.stiffness)
    h = float(scene.model.opt.timestep)
    _, roll = scene.swing(rest + POLE_AMPLITUDE, 0.0, max(duration, 24 * h))
    roll = roll[2:] - rest  # the first steps fill contacts and constraints
    (trace, determinant), *_ = np.linalg.lstsq(
        np.stack([roll[1:-1], -roll[:-2]], axis=1), roll[2:], rcond=None
    )
    integrator = integrator_name(scene.model)
    if integrator != "RK4":
        determinant = min(max(float(determinant), 1e-6), 1 - 1e-9)
        trace = min(float(trace), 1 + determinant - 1e-12)
    inertia, damping = joint_of_map(float(trace), float(determinant), stiffness, h, integrator)
    return TiltJoint(stiffness, damping, inertia)


def _static(scene: ClampedScene, torque: float) -> float:
    """Return the roll under a constant torque [rad]."""
    data, where = mujoco.MjData(scene.model), scene.model.joint(scene.joint)
    data.qfrc_applied[where.dofadr[0]] = scene.sign * torque
    for _ in range(round(2.0 / scene.model.opt.timestep)):
        scene.step(data)
    return scene.sign * float(data.qpos[where.qposadr[0]])


def _no_servos(model: mujoco.MjModel, joint: str) -> bool:
    """Switch off actuators on other joints than the tilt joint."""
    tilt = model.joint(joint).id
    servos = [i for i in range(model.nu) if model.actuator_trnid[i, 0] != tilt]
    for i in servos:
        model.actuator_gainprm[i] = 0
        model.actuator_biasprm[i] = 0
    return bool(servos)


def _no_contacts(model: mujoco.MjModel, joint: str) -> bool:
    """Switch off all contacts, as if the wheels were lifted."""
    touching = bool(np.any(model.geom_contype | model.geom_conaffinity))
    model.geom_contype[:] = 0
    model.geom_conaffinity[:] = 0
    return touching


def _no_coupling(model: mujoco.MjModel, joint: str) -> bool:
    """Take the trucks off the tilt joint."""
    coupled = model.neq > 0
    model.eq_active0[:] = 0
    return coupled


_SWITCHES: tuple[tuple[str, Callable[[mujoco.MjModel, str], bool]], ...] = (
    ("servos", _no_servos),
    ("wheels on the ground", _no_contacts),
    ("the truck steering linkage", _no_coupling),
)


def _reach(scene: ClampedScene) -> float:
    """Return the tilt at which the first truck meets its limit [rad]."""
    model = scene.model
    tilt, reach = model.joint(scene.joint).id, float("inf")
    for i in range(model.neq):
        pair = (int(model.eq_obj1id[i]), int(model.eq_obj2id[i]))
        if model.eq_type[i] != mujoco.mjtEq.mjEQ_JOINT or tilt not in pair:
            continue
        truck = pair[1] if pair[0] == tilt else pair[0]
        slope = abs(float(model.eq_data[i, 1]))
        if model.jnt_limited[truck] and slope > 0:
            limit = float(np.min(np.abs(model.jnt_range[truck])))
            reach = min(reach, limit * slope if pair[0] == tilt else limit / slope)
    return reach
