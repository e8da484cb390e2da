"""The clamped bench: the deck on its tilt joint and nothing else."""

import math

import mujoco
import numpy as np

from sim.board.bodies import TILT_JOINT, add_body, deck_inertia, law_of
from sim.board.scene import add_effects, assert_roll_inertia, integrator_value
from sysid.board import Board
from sysid.quantity import GRAVITY
from sysid.roll import Array


def rig_spec(board: Board, *, timestep: float = 0.001, integrator: str = "implicitfast") -> mujoco.MjSpec:
    """Build the bench from a board record: base clamped, deck free to tilt without a limit.

    Args:
        board: The record; its deck mass, roll inertia, stiffness, damping and effects are built.
        timestep: [s].

    Raises:
        SysidError: The record cannot be built, or the compiled inertia differs from the record.
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
    assert_roll_inertia(spec.compile(), board)
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
