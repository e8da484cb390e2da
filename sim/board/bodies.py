"""The bodies of a board: chassis, deck, trucks, wheels.

The chassis `board` (free joint) is level and has the mass of baseplates, axles and wheels. It carries the deck, which turns on
the tilt joint, and two trucks, which steer on their joints. Each truck carries two wheels on theirs. Trucks and wheels are
light: see `STEERED_SHARE`.
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
"""How the deck's tilt steers the trucks: by a joint equality, or by `set_trucks` after each step, which does not load the tilt
joint."""
Place = tuple[float, float, float]
"""[m]"""

FREE_JOINT = "board_free_joint"
TILT_JOINT = "board_tilt_joint"
TRUCK_JOINTS = ("front_truck_joint", "rear_truck_joint")
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")

STEERED_SHARE = 0.02
"""Share of each truck's and wheel's mass that steers; the rest is at the same place in the chassis.

The trucks of a real deck steer as it rocks, so the measured roll inertia holds their share already. Steered parts of full mass
would add it again: 2 tan²λ times a truck's steering inertia, 1.5 times the deck's own on the HUSKY boards."""

WHEEL_FRICTION = (1.0, 0.001, 0.001)
"""Sliding [1], torsional [m] and rolling [m] friction of a wheel. Sliding and rolling are the HUSKY paper's; torsional is two
thirds of the radius of a small contact patch. The 0.01 m of the authors' release would brake the compliant deck half as much again."""

COASTING = (-5.160, 0.7831, 0.02918)
"""Rolling friction [m] for a loss of speed [m/s^2] at 1 m/s: c₀, c₁, c₂ of `ln friction = c₀ + c₁ L + c₂ L²`, L = ln loss.

It is right to 4 % in this scene under 33 kg, from 0.007 to 0.6 m/s² (`benchmarks/results/hands_off.md`). With a pyramidal cone the
loss of rolling friction grows with the speed and falls with the load."""

WHEEL_IMPEDANCE = (0.99, 0.999)
"""First two numbers of a wheel's solimp [1]. MuJoCo scales the softness of a contact by the mobility of its bodies. These light
wheels sink by 0.8 mm under a rider, by 23 mm with the defaults."""

_DIRECT_ARMATURE = 1.0
"""Armature [kg*m^2] of a truck joint that is set from outside: contacts must not turn it within a step. An armature loads its
own joint only."""

_ORIGIN = np.zeros(3)
"""Centre of mass at the body's origin [m]; MjSpec's default is the body's position in its parent."""

_DECK_COLOUR, _METAL, _WHEEL_COLOUR, _MARKER = "d4ad78", "8c9199", "edede6", "333840"
"""Red, green and blue, in hexadecimal digits."""


def colour(digits: str) -> list[float]:
    """Return red, green, blue and opacity as shares of full [1]."""
    return [*(round(value / 255, 2) for value in bytes.fromhex(digits)), 1.0]


def wheel_friction(board: Board) -> tuple[float, float, float]:
    """Return the friction of the wheels, with the board's measured rolling resistance if it has one."""
    sliding, torsional, rolling = WHEEL_FRICTION
    if board.rolling:
        loss = math.log(board.rolling["deceleration"].value)
        rolling = math.exp(np.polynomial.Polynomial(COASTING)(loss))
    return sliding, torsional, rolling


def add_chassis(spec: mujoco.MjSpec, board: Board) -> mujoco.MjsBody:
    """Add the level parts: the unsteered share of trucks and wheels, as point masses on the axles."""
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
    deck = add_body(root, "deck", (0.0, 0.0, 0.0), board.mass["deck"].value, deck_inertia(board, inertia))
    joint = deck.add_joint(
        name=TILT_JOINT, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1.0, 0.0, 0.0],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE, range=[-tilt_range, tilt_range],
    )  # fmt: skip
    deck.add_geom(
        name="deck_collision", type=mujoco.mjtGeom.mjGEOM_BOX, size=[length / 2, width / 2, thickness / 2],
        rgba=colour(_DECK_COLOUR), condim=3, friction=[1.0, 0.005, 0.0001], priority=1,
    )  # fmt: skip
    for end, sign in (("front", 1.0), ("rear", -1.0)):
        deck.add_site(
            name=f"{end}_marker", type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[sign * board.geometry["wheelbase"].value / 2, 0.0, thickness / 2], size=[0.15, 0.075, 0.001],
            rgba=colour(_MARKER),
        )  # fmt: skip
    return joint


def add_truck(
    root: mujoco.MjsBody, board: Board, end: Literal["front", "rear"], tilt_range: float, coupling: Coupling,
    wheel_friction: Sequence[float],
) -> None:  # fmt: skip
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
        # 5 % beyond the full tilt, so that the tilt joint ends the motion.
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
        name=f"{name}_wheel_collision", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0.0, 0.0], condim=6,
        friction=list(friction), solimp=[*WHEEL_IMPEDANCE, 0.001, 0.5, 2.0], priority=1, group=3,
    )  # fmt: skip
    wheel.add_geom(
        name=f"{name}_wheel_visual", type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        fromto=[0.0, -0.02, 0.0, 0.0, 0.02, 0.0], size=[radius, 0.0, 0.0], contype=0, conaffinity=0,
        rgba=colour(_WHEEL_COLOUR), group=2,
    )  # fmt: skip


def add_body(
    parent: mujoco.MjsBody, name: str, pos: Place, mass: float, inertia: Array,
    centre: Place | Array = _ORIGIN,
) -> mujoco.MjsBody:  # fmt: skip
    """Add a body at `pos` [m] in its parent, of this mass [kg] and inertia [kg*m^2] about its own axes through `centre` [m]."""
    return parent.add_body(name=name, pos=pos, mass=mass, ipos=centre, inertia=inertia, explicitinertial=True)


def steering_angle(roll: float, rake: float) -> float:
    """Return the truck angle σ [rad] of tan σ = tan λ sin roll (HUSKY paper, section on lean-to-steer)."""
    return math.atan(math.tan(rake) * math.sin(roll))


def law_of(board: Board) -> "JointLaw":
    """Return the law of a board's joint; CasADi is imported here only."""
    from sysid.joint.law import JointLaw

    return JointLaw.from_board(board)


def reflected_inertia(board: Board) -> float:
    """Return the roll inertia that steered trucks and rolling wheels add at small tilt [kg*m^2].

    A truck of steering inertia J adds tan²λ J. A wheel of spin inertia j rolls by track / 2 for each radian of its truck and
    adds tan²λ (track / 2r)² j.
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

    It is a cuboid of the record's length, thickness and mass, as wide as the roll inertia needs.

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
        name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=list(size), pos=list(pos), contype=0, conaffinity=0,
        rgba=colour(_METAL), group=2,
    )  # fmt: skip


def substituted(board: Board) -> tuple[str, ...]:
    """Return a line for each effect that MuJoCo lacks: its substitute."""
    return tuple(
        f"effect '{part.name}': MuJoCo has {support.written}"
        for part in board.effects
        if (support := effect(part.name).mujoco).substitute
    ) + left_out(board)


def left_out(board: Board) -> tuple[str, ...]:
    """Return a line for each parameter of an effect that MuJoCo cannot hold."""
    return tuple(
        f"effect '{part.name}': MuJoCo cannot represent its {lost} of {part.parameters[lost].value:.3g} "
        f"{part.parameters[lost].unit}, which is left out"
        for part in board.effects
        if (lost := effect(part.name).mujoco.leaves_out) and part.parameters[lost].value
    )


def as_represented(board: Board) -> Board:
    """Return the board without the parameters that MuJoCo cannot hold."""
    effects = list(board.effects)
    for i, part in enumerate(effects):
        if lost := effect(part.name).mujoco.leaves_out:
            zero = replace(part.parameters[lost], value=0.0)
            effects[i] = replace(part, parameters={**part.parameters, lost: zero})
    return replace(board, effects=tuple(effects))
