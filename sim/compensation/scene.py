"""The deck in its training scene: wheels on the ground, coupling on, the chassis held.

The chassis is held while the deck is released, as in a measurement. A free board weighs less than its spring can lift: the
stiff HUSKY board takes its wheels off the ground beyond seven degrees.
"""

from functools import partial
from typing import Literal

import mujoco

from sim.board.bodies import TILT_JOINT, Coupling
from sim.board.clamped import ClampedScene, stable
from sim.board.scene import board_spec, rig_spec, set_trucks
from sim.compensation.step import (
    Compensation,
    closed_form,
    evaluate,
    fit_inertia_and_damping,
    has_closed_form,
    release_amplitudes,
)
from sysid.board import Board
from sysid.roll import Array

Export = Literal["physical", "step-compensated", "in-scene"]
"""Written parameters: the record's; those with which the joint decays right at this step; or those with which the whole scene
does, wheels and coupling included."""
SETTLING = 1.5
"""Time in which the board sinks into its contacts before it is held [s]: it is still to 1e-15 m after half of it."""


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
        after_step=partial(set_trucks, rake=board.geometry["rake"].value) if coupling == "direct" else None,
    )


def bench_scene(board: Board, *, timestep: float, integrator: str = "implicitfast") -> ClampedScene:
    """Return the clamped bench of a board as written (compensated or not).

    Raises:
        SysidError: It cannot be built.
    """
    spec = rig_spec(board, timestep=timestep, integrator=integrator)
    return ClampedScene(model=spec.compile(), name=f"clamped bench, {integrator} at {1e3 * timestep:g} ms")


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
    board: Board, export: Export, *, timestep: float = 0.005, integrator: str = "implicitfast",
    coupling: Coupling = "equality",
) -> Compensation:  # fmt: skip
    """Return the board to be written for an export.

    Roll inertia and damping make up for the step, and in the scene also for wheels, contacts and coupling. The static
    stiffness is the record's.

    Args:
        timestep: [s].

    Raises:
        SysidError: The board cannot be built, the step is too long for it, the integrator damps more than it does, or nothing
            pulls it back.
    """
    amplitudes = release_amplitudes(board)
    build = partial(bench_scene, timestep=timestep, integrator=integrator)
    if export == "in-scene":
        build = partial(training_scene, timestep=timestep, integrator=integrator, coupling=coupling)
        amplitudes = tuple(0.95 * angle for angle in amplitudes)  # a limit pushes just before its end
    written, how = board, "physical parameters"
    if export != "physical":
        written, how = (
            closed_form(board, timestep=timestep, integrator=integrator),
            "compensated in closed form",
        )
        if export == "in-scene" or not has_closed_form(board):
            written, how = (
                fit_inertia_and_damping(board, written, build, amplitudes),
                "compensated numerically",
            )
    if export == "in-scene":
        how = f"compensated in the scene ({coupling} coupling, wheels on the ground)"
    return evaluate(board, written, build, amplitudes, how)
