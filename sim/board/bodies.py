"""The bodies of a board: chassis, deck, trucks, wheels.

Bodies::

    board (free joint)                  what stays level: baseplates, axles and the wheels' mass
    ├── deck  board_tilt_joint          turns with the deck
    ├── front_truck  front_truck_joint  steers; light, see STEERED_SHARE
    │   ├── front_left_wheel …_joint
    │   └── front_right_wheel
    └── rear_truck  rear_truck_joint
        ├── rear_left_wheel
        └── rear_right_wheel
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import mujoco
import numpy as np

from sysid.board import Board
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.roll import Array

if TYPE_CHECKING:
    from sysid.joint.law import JointLaw

Coupling = Literal["equality", "direct"]
"""How the deck's tilt steers the trucks: by a joint equality constraint, or by setting the truck
angles after each step (`set_trucks`), which puts no load on the tilt joint."""
Place = tuple[float, float, float]
"""[m]"""

FREE_JOINT = "board_free_joint"
TILT_JOINT = "board_tilt_joint"
TRUCK_JOINTS = ("front_truck_joint", "rear_truck_joint")
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")

STEERED_SHARE = 0.02
"""Share of each truck's and wheel's mass that steers; the rest sits at the same place in the chassis.

The trucks steer while a real deck rocks, so the measured roll inertia already holds what they add to
it. Steered parts of full weight would add it again through the coupling: 2 tan²λ times a truck's
steering inertia, for the HUSKY boards one and a half times the deck's own."""

WHEEL_FRICTION = (1.0, 0.001, 0.001)
"""Sliding [1], torsional [m] and rolling [m] friction of a wheel. Sliding and rolling are the HUSKY
paper's; torsional is two thirds of the radius of a small contact patch. Through the coupling it brakes
the deck: the 0.01 m of the authors' release would add half to the compliant board's damping."""

COASTING = (
    (0.00025, 0.0073), (0.0005, 0.0290), (0.001, 0.0848), (0.0015, 0.155), (0.002, 0.237), (0.003, 0.427), (0.004, 0.635),
)  # fmt: skip
"""Rolling friction [m], and the loss of speed at 1 m/s that it makes in this scene under 33 kg [m/s^2]. It is no Coulomb
friction: a pyramidal cone makes of it a loss that grows with the speed and falls with the load
(`benchmarks/results/hands_off.md`)."""

WHEEL_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)
"""Contact impedance of a wheel [1], its width in m. MuJoCo scales a contact's softness by the mobility of the bodies in
touch; with its default, wheels as light as these would sink by 23 mm under a rider; with this, 0.8 mm."""

_DIRECT_ARMATURE = 1.0
"""Armature [kg*m^2] of a truck joint whose angle is set from outside: contact forces must not turn it
within a step. An armature loads only its own joint, neither the deck nor the board."""

_ORIGIN = (0.0, 0.0, 0.0)
"""Centre of mass at the body's origin [m]; left out, MjSpec puts it at the body's position in its parent."""

_DECK_COLOUR = (0.83, 0.68, 0.47, 1.0)
_METAL = (0.55, 0.57, 0.60, 1.0)
_WHEEL_COLOUR = (0.93, 0.93, 0.90, 1.0)
"""Red, green, blue and opacity, as a share of full."""


def wheel_friction(board: Board) -> tuple[float, float, float]:
    """Return the wheels' friction, rolling as it was measured on the board where it was."""
    sliding, torsional, rolling = WHEEL_FRICTION
    if board.rolling:
        frictions, losses = np.log(COASTING).T
        rolling = float(np.exp(np.interp(np.log(board.rolling["deceleration"].value), losses, frictions)))
    return sliding, torsional, rolling


def add_chassis(spec: mujoco.MjSpec, board: Board) -> mujoco.MjsBody:
    """Add what stays level: the unsteered share of trucks and wheels, as point masses on the axles."""
    geometry = board.geometry
    axle_x, wheel_y = geometry["wheelbase"].value / 2, geometry["track"].value / 2
    axle_z = -geometry["truck_height"].value
    truck = (1 - STEERED_SHARE) * board.mass["truck"].value
    wheel = (1 - STEERED_SHARE) * board.mass["wheel"].value
    hanger = _hanger_inertia(truck, geometry["track"].value, geometry["wheel_radius"].value)
    spread = np.array([4 * wheel * wheel_y**2, 0.0, 4 * wheel * wheel_y**2])
    along = (2 * truck + 4 * wheel) * axle_x**2
    place, inertia = (
        (0.0, 0.0, geometry["wheel_radius"].value - axle_z),
        2 * hanger + spread + [0.0, along, along],
    )
    body = add_body(spec.worldbody, "board", place, 2 * truck + 4 * wheel, inertia, (0.0, 0.0, axle_z))
    body.add_freejoint(name=FREE_JOINT)
    for end, x in (("front", axle_x), ("rear", -axle_x)):
        _visual(body, f"{end}_baseplate_visual", [0.04, 0.025, -axle_z / 2 - 0.01], [x, 0.0, axle_z / 2])
    body.add_site(name="board_site", pos=[0.0, 0.0, 0.0], group=4)
    return body


def add_deck(root: mujoco.MjsBody, board: Board, inertia: float, tilt_range: float) -> mujoco.MjsJoint:
    """Add the deck: a cuboid of this roll inertia [kg*m^2], its centre on the tilt axis."""
    length, width, thickness = (board.geometry[key].value for key in ("length", "width", "thickness"))
    deck = add_body(root, "deck", _ORIGIN, board.mass["deck"].value, deck_inertia(board, inertia))
    joint = deck.add_joint(
        name=TILT_JOINT,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[1.0, 0.0, 0.0],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=[-tilt_range, tilt_range],
    )
    deck.add_geom(
        name="deck_collision",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[length / 2, width / 2, thickness / 2],
        rgba=list(_DECK_COLOUR),
        condim=3,
        friction=[1.0, 0.005, 0.0001],
        priority=1,
    )
    for end, sign in (("front", 1.0), ("rear", -1.0)):
        deck.add_site(
            name=f"{end}_marker",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[sign * board.geometry["wheelbase"].value / 2, 0.0, thickness / 2],
            size=[0.15, 0.075, 0.001],
            rgba=[0.20, 0.22, 0.25, 1.0],
        )
    return joint


def add_truck(
    root: mujoco.MjsBody,
    board: Board,
    end: Literal["front", "rear"],
    tilt_range: float,
    coupling: Coupling,
    wheel_friction: Sequence[float],
) -> None:
    """Add a truck on its steering joint with two wheels; the body's origin is the middle of its axle."""
    geometry = board.geometry
    sign = 1.0 if end == "front" else -1.0
    radius, track = geometry["wheel_radius"].value, geometry["track"].value
    mass = STEERED_SHARE * board.mass["truck"].value
    axle = (sign * geometry["wheelbase"].value / 2, 0.0, -geometry["truck_height"].value)
    truck = add_body(root, f"{end}_truck", axle, mass, _hanger_inertia(mass, track, radius))
    limits = mujoco.mjtLimited
    limit = 1.05 * steering_angle(min(tilt_range, math.pi / 2), geometry["rake"].value)
    truck.add_joint(
        name=f"{end}_truck_joint",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, 0.0, -sign],
        # A little more than the full tilt needs, so that it is the tilt joint that ends the motion.
        limited=limits.mjLIMITED_TRUE if coupling == "equality" else limits.mjLIMITED_FALSE,
        range=[-limit, limit],
        armature=_DIRECT_ARMATURE if coupling == "direct" else 0.0,
    )
    _visual(truck, f"{end}_hanger_visual", [0.012, track / 2 - 0.02, 0.012])
    wheel_mass = STEERED_SHARE * board.mass["wheel"].value
    for side, y in (("left", track / 2), ("right", -track / 2)):
        _add_wheel(truck, f"{end}_{side}", y, radius, wheel_mass, wheel_friction)


def _add_wheel(
    truck: mujoco.MjsBody, name: str, y: float, radius: float, mass: float, friction: Sequence[float]
) -> None:
    """Add a wheel: a sphere to touch the ground, since a cylinder's two edges scrub when it steers."""
    wheel = add_body(truck, f"{name}_wheel", (0.0, y, 0.0), mass, _wheel_inertia(mass, radius))
    wheel.add_joint(name=f"{name}_wheel_joint", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 1.0, 0.0])
    wheel.add_geom(
        name=f"{name}_wheel_collision",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[radius, 0.0, 0.0],
        condim=6,
        friction=list(friction),
        solimp=list(WHEEL_SOLIMP),
        priority=1,
        group=3,
    )
    wheel.add_geom(
        name=f"{name}_wheel_visual",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        fromto=[0.0, -0.02, 0.0, 0.0, 0.02, 0.0],
        size=[radius, 0.0, 0.0],
        contype=0,
        conaffinity=0,
        rgba=list(_WHEEL_COLOUR),
        group=2,
    )


def add_body(
    parent: mujoco.MjsBody, name: str, pos: Place, mass: float, inertia: Array, centre: Place = _ORIGIN
) -> mujoco.MjsBody:
    """Add a body at `pos` [m] in its parent, of this mass [kg] and inertia [kg*m^2] about its own axes through `centre` [m]."""
    return parent.add_body(name=name, pos=pos, mass=mass, ipos=centre, inertia=inertia, explicitinertial=True)


def steering_angle(roll: float, rake: float) -> float:
    """Return the truck angle σ [rad] of tan σ = tan λ sin roll (HUSKY paper, section on lean-to-steer)."""
    return math.atan(math.tan(rake) * math.sin(roll))


def law_of(board: Board) -> "JointLaw":
    """Return the law of a board's joint; only here is CasADi imported."""
    from sysid.joint.law import JointLaw

    return JointLaw.from_board(board)


def inertia_ratio(board: Board) -> float:
    """Return by how much the record's effects multiply its roll inertia."""
    # Only boards with effects need the catalogue.
    return law_of(board).inertia_ratio if board.effects else 1.0


def inertia_gain(board: Board) -> float:
    """Return by how much the record's effects multiply what is added to its roll inertia."""
    return law_of(board).inertia_gain if board.effects else 1.0


def reflected_inertia(board: Board) -> float:
    """Return the roll inertia that steered trucks and rolling wheels add at small tilt [kg*m^2].

    Through the coupling a truck of steering inertia J counts tan²λ J, and a wheel of spin inertia j,
    which rolls by track / 2 for each radian that its truck turns, tan²λ (track / 2r)² j.
    """
    track, radius = board.geometry["track"].value, board.geometry["wheel_radius"].value
    truck = STEERED_SHARE * board.mass["truck"].value
    wheel = STEERED_SHARE * board.mass["wheel"].value
    steering = _hanger_inertia(truck, track, radius)[2]
    steering += 2 * (wheel * track**2 / 4 + _wheel_inertia(wheel, radius)[2])
    rolling = 4 * _wheel_inertia(wheel, radius)[1] * (track / 2 / radius) ** 2
    return float(math.tan(board.geometry["rake"].value) ** 2 * (2 * steering + rolling))


def deck_inertia(board: Board, roll: float) -> Array:
    """Return a deck's principal inertia [kg*m^2], shape (3,).

    As of a cuboid of the record's length, thickness and mass, and of the width that has the roll inertia.

    Args:
        roll: Inertia about the tilt axis [kg*m^2].

    Raises:
        SysidError: No deck of this thickness has so small a roll inertia.
    """
    length, thickness = board.geometry["length"].value, board.geometry["thickness"].value
    mass = board.mass["deck"].value
    if roll <= mass * thickness**2 / 12:
        raise SysidError(
            f"board '{board.name}': a roll inertia of {roll:.4g} kg*m^2 is impossible for a deck of {mass:.4g} kg "
            f"and {thickness:.3g} m thickness. Check inertia, mass.deck and geometry.thickness."
        )
    pitch = mass * (length**2 + thickness**2) / 12
    return np.array([roll, pitch, roll + mass * (length**2 - thickness**2) / 12])


def _hanger_inertia(mass: float, track: float, radius: float) -> Array:
    """Inertia [kg*m^2] of a truck's hanger: a rod of the track's length, as thick as a wheel's radius."""
    across = mass * (track**2 + radius**2) / 12
    return np.array([across, mass * radius**2 / 6, across])


def _wheel_inertia(mass: float, radius: float) -> Array:
    """Inertia [kg*m^2] of a wheel: a disc about the y axis."""
    return mass * radius**2 * np.array([0.25, 0.5, 0.25])


def _visual(
    body: mujoco.MjsBody, name: str, size: Sequence[float], pos: Sequence[float] = (0.0, 0.0, 0.0)
) -> None:
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=list(size),
        pos=list(pos),
        contype=0,
        conaffinity=0,
        rgba=list(_METAL),
        group=2,
    )


def substituted(board: Board) -> tuple[str, ...]:
    """Say for each effect of a board that MuJoCo cannot hold what is written in its place."""
    return tuple(
        f"effect '{part.name}': MuJoCo has {support.written}"
        for part in board.effects
        if (support := effect(part.name).mujoco).substitute
    ) + left_out(board)


def left_out(board: Board) -> tuple[str, ...]:
    """Say what of a board's effects MuJoCo cannot represent, though it has the rest of them."""
    return tuple(
        f"effect '{part.name}': MuJoCo cannot represent its {lost} of {part.parameters[lost].value:.3g} "
        f"{part.parameters[lost].unit}, which is left out"
        for part in board.effects
        if (lost := effect(part.name).mujoco.leaves_out) and part.parameters[lost].value
    )


def as_represented(board: Board) -> Board:
    """Return the board without what MuJoCo cannot represent of its effects."""
    parts = [(part, effect(part.name).mujoco.leaves_out) for part in board.effects]
    return replace(
        board,
        effects=tuple(
            replace(part, parameters={**part.parameters, lost: replace(part.parameters[lost], value=0.0)})
            if lost
            else part
            for part, lost in parts
        ),
    )
