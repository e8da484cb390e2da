"""The deck in its training scene: wheels on the ground, coupling on, the chassis held.

The chassis is held while the deck is released, as in a measurement. A free board weighs less than its spring can lift: the
stiff HUSKY board takes its wheels off the ground beyond seven degrees.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from sim.board.bench import AfterStep, Begin, Swing, rig_spec, stable, swing
from sim.board.bodies import FREE_JOINT, TILT_JOINT, Coupling
from sim.board.scene import board_spec, integrator_name, set_trucks
from sim.compensation.step import (
    Compensation,
    closed_form,
    compensate_step,
    evaluate,
    fit_inertia_and_damping,
    release_amplitudes,
    uncompensated,
)
from sysid.board import Board
from sysid.errors import SysidError, did_you_mean
from sysid.roll import Array

Export = Literal["physical", "step-compensated", "in-scene"]
"""Written parameters: the record's; those with which the joint decays right at this step; or those with which the whole scene
does, wheels and coupling included."""
SETTLING = 1.5
"""Time in which the board sinks into its contacts before it is held [s]: it is still to 1e-15 m after half of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClampedScene:
    """A compiled scene with its chassis held, ready for a release."""

    model: mujoco.MjModel
    name: str
    """In words, for the record and the report."""
    joint: str = TILT_JOINT
    after_step: AfterStep | None = None
    begin: Begin | None = None
    """Sets a robot's model to a release. Its limits then act in MuJoCo and do not end the compared decay."""

    def swing(self, angle: float, rate: float, duration: float) -> Swing:
        """Release the joint, see `sim.board.bench.swing`."""
        return swing(
            self.model, angle, rate, duration, joint=self.joint, after_step=self.after_step, begin=self.begin
        )

    @property
    def tilt_range(self) -> float:
        """Largest tilt that the joint allows to both sides [rad]; infinite without a limit."""
        if self.begin is not None:
            return float("inf")
        joint = self.model.joint(self.joint)
        limited = bool(self.model.jnt_limited[joint.id])
        return float(min(abs(joint.range[0]), abs(joint.range[1]))) if limited else float("inf")


def training_scene(
    board: Board, *, timestep: float = 0.005, integrator: str = "implicitfast",
    coupling: Coupling = "equality",
) -> ClampedScene:  # fmt: skip
    """Build our scene of a board as written (compensated or not) and hold its chassis.

    Raises:
        SysidError: The board cannot be built.
    """
    spec = board_spec(board, timestep=timestep, integrator=integrator, coupling=coupling)
    hold(spec, TILT_JOINT)
    return ClampedScene(
        model=spec.compile(),
        name=f"board on its wheels, {coupling} coupling, {integrator} at {1e3 * timestep:g} ms",
        after_step=_set_trucks(board) if coupling == "direct" else None,
    )


def bench_scene(board: Board, *, timestep: float, integrator: str = "implicitfast") -> ClampedScene:
    """Return the clamped bench of a board as written (compensated or not).

    Raises:
        SysidError: It cannot be built.
    """
    spec = rig_spec(board, timestep=timestep, integrator=integrator)
    return ClampedScene(model=spec.compile(), name=f"clamped bench, {integrator} at {1e3 * timestep:g} ms")


def scene_from_file(path: Path, *, joint: str = TILT_JOINT, timestep: float | None = None) -> ClampedScene:
    """Read any MJCF scene with a board in it and hold its chassis.

    Args:
        joint: Name of the tilt joint, with prefix; its axis is +x or -x.
        timestep: Step instead of the file's [s].

    Raises:
        SysidError: The file cannot be read or compiled, or has no such joint.
    """
    if not path.is_file():
        raise SysidError(f"{path}: there is no such scene file.")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compile()
    except (OSError, ValueError) as error:
        raise SysidError(f"{path}: MuJoCo cannot read it ({str(error).strip().splitlines()[0]}).") from error
    names = [known.name for known in spec.joints if known.name]
    if joint not in names:
        raise SysidError(
            f"{path}: there is no joint '{joint}'.{did_you_mean(joint, names)} Joints: {', '.join(names)}. "
            "Name the tilt joint with --joint."
        )
    axis = np.asarray(spec.joint(joint).axis)
    if abs(axis[0]) < 0.999 * np.linalg.norm(axis):
        raise SysidError(f"{path}: joint '{joint}' turns about {axis}; a tilt joint turns about +x or -x.")
    if timestep is not None:
        spec.option.timestep = timestep
    hold(spec, joint)
    model = spec.compile()
    return ClampedScene(
        model=model,
        joint=joint,
        name=f"{path.name}, {integrator_name(model)} at {1e3 * model.opt.timestep:g} ms",
    )


def hold(spec: mujoco.MjSpec, joint: str) -> None:
    """Let the board sink into its contacts, then delete the free joint of the body that carries the tilt joint.

    A spec without that free joint (a bench) is unchanged.
    """
    body = spec.joint(joint).parent
    while body is not None and body.name != "world":
        free = next((j for j in body.joints if j.type == mujoco.mjtJoint.mjJNT_FREE), None)
        if free is not None:
            break
        body = body.parent
    else:
        return
    pose = _settled_pose(spec, free)
    spec.delete(free)
    body.pos, body.quat = pose[:3], pose[3:]
    for key in list(spec.keys):  # their positions no longer fit
        spec.delete(key)


def _settled_pose(spec: mujoco.MjSpec, free: mujoco.MjsJoint) -> Array:
    model = spec.compile()
    data = mujoco.MjData(model)
    with stable(model, data):
        mujoco.mj_step(model, data, nstep=round(SETTLING / model.opt.timestep))
    address = int(model.jnt_qposadr[free.id])
    return data.qpos[address : address + 7].copy()


def compensate(
    board: Board, export: Export, *, timestep: float, integrator: str = "implicitfast",
    coupling: Coupling = "equality",
) -> Compensation:  # fmt: skip
    """Return the board to be written for an export; arguments as in `compensate_in_scene`."""
    if export == "in-scene":
        return compensate_in_scene(board, timestep=timestep, integrator=integrator, coupling=coupling)
    make = compensate_step if export == "step-compensated" else uncompensated
    return make(board, timestep=timestep, integrator=integrator)


def compensate_in_scene(
    board: Board, *, timestep: float = 0.005, integrator: str = "implicitfast",
    coupling: Coupling = "equality",
) -> Compensation:  # fmt: skip
    """Return the board to be written so that the whole scene decays like the record's law.

    The deck's roll inertia and damping make up for wheels, contacts, coupling and the step. The static stiffness is the
    record's.

    Args:
        timestep: [s].

    Raises:
        SysidError: The board cannot be built or the step is too long for it.
    """
    build = _builder(board, timestep, integrator, coupling)
    amplitudes = [0.95 * angle for angle in release_amplitudes(board)]
    after_step = _set_trucks(board) if coupling == "direct" else None
    start = closed_form(board, timestep=timestep, integrator=integrator)
    written = fit_inertia_and_damping(board, start, build, amplitudes, after_step=after_step)
    how = f"compensated in the scene ({coupling} coupling, wheels on the ground)"
    return evaluate(board, written, build, amplitudes, how, after_step=after_step)


def _builder(
    board: Board, timestep: float, integrator: str, coupling: Coupling
) -> Callable[[Board], mujoco.MjModel]:
    """Return the function that compiles candidates in the pose into which the first one has sunk."""
    built = partial(board_spec, timestep=timestep, integrator=integrator, coupling=coupling)
    first = built(board)
    pose = _settled_pose(first, first.joint(FREE_JOINT))

    def build(candidate: Board) -> mujoco.MjModel:
        spec = built(candidate)
        spec.delete(spec.joint(FREE_JOINT))
        body = spec.body("board")
        body.pos, body.quat = pose[:3], pose[3:]
        return spec.compile()

    return build


def _set_trucks(board: Board) -> AfterStep:
    rake = board.geometry["rake"].value

    def after_step(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        set_trucks(model, data, rake)

    return after_step
