"""The free board as MJCF: deck on a sprung tilt joint, steered trucks, wheels, ground.

Bodies::

    board (free joint)                  what stays level: baseplates, axles and the wheels' mass
    ├── deck  board_tilt_joint          turns with the deck
    ├── front_truck  front_truck_joint  steers; light, see STEERED_SHARE
    │   ├── front_left_wheel …_joint
    │   └── front_right_wheel
    └── rear_truck  rear_truck_joint
        ├── rear_left_wheel
        └── rear_right_wheel

Every joint's position has the sign of a right turn: `board_tilt_joint` is the roll (right edge down
is positive), and both truck joints are the steering angle σ of tan σ = tan λ sin roll, the front one
turning right and the rear one left, so a board with its right edge down turns right.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import mujoco
import numpy as np

from sysid.board import Board
from sysid.errors import HuskyError
from sysid.quantity import Quantity
from sysid.roll import Array

Coupling = Literal["equality", "direct"]
"""How the deck's tilt steers the trucks: by a joint equality constraint, or by setting the truck
angles after each step (`set_trucks`), which puts no load on the tilt joint."""

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

WHEEL_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)
"""Contact impedance of a wheel. MuJoCo scales a contact's softness by the mobility of the bodies in
touch; with its default, wheels as light as these would sink by 23 mm under a rider; with this, 0.8 mm."""

_DIRECT_ARMATURE = 1.0
"""Armature [kg*m^2] of a truck joint whose angle is set from outside: contact forces must not turn it
within a step. An armature loads only its own joint, neither the deck nor the board."""

_ORIGIN = (0.0, 0.0, 0.0)
"""Centre of mass at the body's origin; left out, MjSpec puts it at the body's position in its parent."""

_DECK_COLOUR = (0.83, 0.68, 0.47, 1.0)
_METAL = (0.55, 0.57, 0.60, 1.0)
_WHEEL_COLOUR = (0.93, 0.93, 0.90, 1.0)


def board_spec(
    board: Board,
    *,
    coupling: Coupling = "equality",
    ground: bool = True,
    timestep: float = 0.005,
    integrator: str = "implicitfast",
    tilt_range: float | None = None,
    wheel_friction: Sequence[float] = WHEEL_FRICTION,
    exact_effects: bool = True,
) -> mujoco.MjSpec:
    """Build the free board from its record, effects included.

    Args:
        board: The record; what is built has its masses, roll inertia, stiffness, damping, effects.
        coupling: How tilt steers the trucks. With 'equality' the deck's own roll inertia is the
            record's less what the steered parts add to it.
        ground: Whether to add the ground and a light. Without them the spec is an entity for
            attaching to another scene (with a prefix of its own), whose options count.
        timestep: Step of the scene [s]; the coupling is as stiff as this step allows.
        integrator: MuJoCo's name of the integrator.
        tilt_range: Largest tilt to either side [rad]; the record's if None.
        wheel_friction: Sliding [1], torsional [m] and rolling [m] friction of the wheels.
        exact_effects: False writes effects that need a MuJoCo newer than 3.11 as their substitutes.

    Raises:
        HuskyError: The record cannot be built: inertia too small for the deck's mass, rake and tilt
            range that do not fit, or compiled mass or inertia differ from the record.
    """
    spec = mujoco.MjSpec()
    spec.modelname = board.name
    spec.compiler.degree = False
    if ground:
        spec.option.timestep = timestep
        spec.option.integrator = integrator_value(integrator)
        _add_ground(spec)
    limit = board.tilt["range"].value if tilt_range is None else tilt_range
    root = _add_chassis(spec, board)
    reflected = reflected_inertia(board) if coupling == "equality" else 0.0
    # What steers is taken off the deck, so that nothing is counted twice; the effect 'inertia', if there
    # is one, will multiply what is written here.
    tilt = _add_deck(root, board, board.inertia.value - reflected / inertia_ratio(board), limit)
    for end in ("front", "rear"):
        _add_truck(root, board, end, limit, coupling, wheel_friction)
    for wheel in WHEELS:
        # A deck at full tilt would touch its own wheels; a real one has risers against wheel bite.
        spec.add_exclude(name=f"deck_{wheel}_wheel", bodyname1="deck", bodyname2=f"{wheel}_wheel")
    if coupling == "equality":
        _add_coupling(spec, board, limit, timestep)
    add_effects(spec, tilt, board, exact=exact_effects)
    assert_matches_record(spec, board, coupling)
    return spec


def set_trucks(model: mujoco.MjModel, data: mujoco.MjData, rake: float, prefix: str = "") -> None:
    """Set both truck joints from the tilt, position and velocity: the `direct` coupling.

    To be called after every step (and after every reset) of a scene built with coupling='direct'.

    Args:
        model: Compiled scene.
        data: Its state; changed in place.
        rake: λ of tan σ = tan λ sin roll [rad].
        prefix: The board's name prefix in the scene.
    """
    tilt = model.joint(prefix + TILT_JOINT)
    roll, rate = float(data.qpos[tilt.qposadr[0]]), float(data.qvel[tilt.dofadr[0]])
    angle = steering_angle(roll, rake)
    speed = rate * math.tan(rake) * math.cos(roll) * math.cos(angle) ** 2
    for name in TRUCK_JOINTS:
        truck = model.joint(prefix + name)
        data.qpos[truck.qposadr[0]] = angle
        data.qvel[truck.dofadr[0]] = speed


def steering_angle(roll: float, rake: float) -> float:
    """Return the truck angle σ [rad] of tan σ = tan λ sin roll (HUSKY paper, section on lean-to-steer)."""
    return math.atan(math.tan(rake) * math.sin(roll))


def coupling_polynomial(rake: float, tilt_range: float) -> tuple[Array, float]:
    """Fit σ ≈ a roll + b roll³ to tan σ = tan λ sin roll over ± `tilt_range`.

    MuJoCo's joint equality takes a polynomial of up to the fourth degree; the law is odd.

    Returns:
        The five coefficients for `polycoef`, and the largest error [rad].
    """
    roll = tilt_range * np.sin(np.linspace(-np.pi / 2, np.pi / 2, 201))  # dense at the ends, as Chebyshev's
    angle = np.arctan(np.tan(rake) * np.sin(roll))
    basis = np.stack([roll, roll**3], axis=1)
    (linear, cubic), *_ = np.linalg.lstsq(basis, angle, rcond=None)
    error = float(np.max(np.abs(basis @ [linear, cubic] - angle)))
    return np.array([0.0, linear, 0.0, cubic, 0.0]), error


def integrator_value(name: str) -> int:
    """Return MuJoCo's number of an integrator.

    Raises:
        HuskyError: This MuJoCo has no integrator of that name.
    """
    known = {
        key.removeprefix("mjINT_").lower(): value
        for key, value in mujoco.mjtIntegrator.__members__.items()
        if key.startswith("mjINT_")
    }
    if name.lower() not in known:
        raise HuskyError(
            f"unknown integrator '{name}'. MuJoCo {mujoco.__version__} has: {', '.join(sorted(known))}."
        )
    return int(known[name.lower()])


def add_effects(
    spec: mujoco.MjSpec, joint: mujoco.MjsJoint, board: Board, *, exact: bool = True
) -> tuple[str, ...]:
    """Put spring, damper and the record's effects on a tilt joint.

    Args:
        spec: The spec; changed in place.
        joint: Its tilt joint.
        board: The record.
        exact: False writes effects that need a MuJoCo newer than 3.11 as their substitutes.

    Returns:
        One line for each thing that an effect wrote.
    """
    joint.stiffness[0] = board.stiffness
    joint.damping[0] = board.damping
    joint.springref = board.rest_angle
    if not board.effects:
        return ()
    from sysid.effects import effect  # only boards with effects need the catalogue

    # An effect that puts the joint on a support moves all that the joint carries: it comes last.
    parts = sorted(board.effects, key=lambda part: effect(part.name).role == "support")
    lines: list[str] = []
    for part in parts:
        values = {name: quantity.value for name, quantity in part.parameters.items()}
        lines += effect(part.name).to_mjcf(spec, joint, values, exact=exact)
    deck = joint.parent
    # An effect that lowers roll inertia makes a narrower deck, which turns more easily about z too.
    deck.inertia[2] = min(deck.inertia[2], 0.999 * (deck.inertia[0] + deck.inertia[1]))
    return tuple(lines)


def assert_matches_record(spec: mujoco.MjSpec, board: Board, coupling: Coupling) -> None:
    """Compile the spec and compare total mass and roll inertia about the tilt axis with the record.

    What the file was meant to hold is not what MuJoCo simulates: geoms add mass where an inertial is
    missing, a centre of mass is not where it was thought, a deck's inertia is counted twice.

    Raises:
        HuskyError: They differ.
    """
    model = spec.compile()
    expected = board.mass["deck"].value + 2 * board.mass["truck"].value + 4 * board.mass["wheel"].value
    weight = float(model.body_mass.sum())
    if not math.isclose(weight, expected, rel_tol=1e-3):  # a support that an effect adds weighs a gram
        raise HuskyError(
            f"board '{board.name}': the compiled board weighs {weight:.6g} kg, its record says {expected:.6g} kg."
        )
    inertia = roll_inertia(model, board.geometry if coupling == "equality" else None)
    recorded = inertia_ratio(board) * board.inertia.value
    if not math.isclose(inertia, recorded, rel_tol=1e-6):
        raise HuskyError(
            f"board '{board.name}': the compiled roll inertia is {inertia:.6g} kg*m^2, the record says "
            f"{recorded:.6g} kg*m^2."
        )


def roll_inertia(
    model: mujoco.MjModel, geometry: Mapping[str, Quantity] | None = None, joint: str = TILT_JOINT
) -> float:
    """Return the compiled inertia about the tilt axis [kg*m^2], the chassis held.

    Args:
        model: Compiled scene or rig.
        geometry: The board's; with it the steered trucks and the wheels that they turn are included
            as the coupling brings them to the tilt joint: angle × tan λ, wheels rolling without slip.
        joint: Name of the tilt joint.
    """
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    motion = np.zeros(model.nv)  # of all joints, for a roll rate of 1 rad/s
    motion[model.joint(joint).dofadr[0]] = 1.0
    if geometry is not None:
        steer = math.tan(geometry["rake"].value)
        roll = steer * geometry["track"].value / 2 / geometry["wheel_radius"].value
        for name in TRUCK_JOINTS:
            motion[model.joint(name).dofadr[0]] = steer
        for name in WHEELS:
            left, front = name.endswith("left"), name.startswith("front")
            motion[model.joint(f"{name}_wheel_joint").dofadr[0]] = roll if left == front else -roll
    return float(motion @ inertia @ motion)


def inertia_ratio(board: Board) -> float:
    """Return by how much the record's effects multiply its roll inertia (the effect 'inertia')."""
    return math.prod(part.parameters["ratio"].value for part in board.effects if part.name == "inertia")


def reflected_inertia(board: Board) -> float:
    """Return what steered trucks and rolling wheels add to the roll inertia at small tilt [kg*m^2].

    Through the coupling a truck of steering inertia J counts tan²λ J, and a wheel of spin inertia j,
    which rolls by track / 2 for each radian that its truck turns, tan²λ (track / 2r)² j.
    """
    track, radius = board.geometry["track"].value, board.geometry["wheel_radius"].value
    truck = STEERED_SHARE * board.mass["truck"].value
    wheel = STEERED_SHARE * board.mass["wheel"].value
    steering = _hanger_inertia(truck, track, radius)[2] + 2 * (
        wheel * track**2 / 4 + _wheel_inertia(wheel, radius)[2]
    )
    rolling = 4 * _wheel_inertia(wheel, radius)[1] * (track / 2 / radius) ** 2
    return float(math.tan(board.geometry["rake"].value) ** 2 * (2 * steering + rolling))


def _add_ground(spec: mujoco.MjSpec) -> None:
    spec.stat.extent = 0.8  # what a viewer shows at first
    spec.stat.center = [0.0, 0.0, 0.05]
    spec.worldbody.add_geom(
        name="ground",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[5.0, 5.0, 0.1],
        rgba=[0.32, 0.36, 0.40, 1.0],
    )
    spec.worldbody.add_light(
        name="sun",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[0.0, 0.0, 3.0],
        dir=[0.2, 0.3, -1.0],
        castshadow=False,
    )


def _add_chassis(spec: mujoco.MjSpec, board: Board) -> mujoco.MjsBody:
    """Add what stays level: the unsteered share of trucks and wheels, as point masses on the axles."""
    geometry = board.geometry
    axle_x, wheel_y = geometry["wheelbase"].value / 2, geometry["track"].value / 2
    axle_z = -geometry["truck_height"].value
    truck = (1 - STEERED_SHARE) * board.mass["truck"].value
    wheel = (1 - STEERED_SHARE) * board.mass["wheel"].value
    hanger = _hanger_inertia(truck, geometry["track"].value, geometry["wheel_radius"].value)
    spread = np.array([4 * wheel * wheel_y**2, 0.0, 4 * wheel * wheel_y**2])
    along = (2 * truck + 4 * wheel) * axle_x**2
    body = spec.worldbody.add_body(
        name="board",
        pos=[0.0, 0.0, geometry["wheel_radius"].value - axle_z],
        mass=2 * truck + 4 * wheel,
        ipos=[0.0, 0.0, axle_z],
        inertia=2 * hanger + spread + [0.0, along, along],
        explicitinertial=True,
    )
    body.add_freejoint(name=FREE_JOINT)
    for end, x in (("front", axle_x), ("rear", -axle_x)):
        _visual(body, f"{end}_baseplate_visual", [0.04, 0.025, -axle_z / 2 - 0.01], [x, 0.0, axle_z / 2])
    body.add_site(name="board_site", pos=[0.0, 0.0, 0.0], group=4)
    return body


def _add_deck(root: mujoco.MjsBody, board: Board, inertia: float, tilt_range: float) -> mujoco.MjsJoint:
    """Add the deck: a cuboid of this roll inertia [kg*m^2], its centre on the tilt axis."""
    length, width, thickness = (board.geometry[key].value for key in ("length", "width", "thickness"))
    deck = root.add_body(
        name="deck",
        mass=board.mass["deck"].value,
        ipos=_ORIGIN,
        inertia=deck_inertia(board, inertia),
        explicitinertial=True,
    )
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


def _add_truck(
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
    truck = root.add_body(
        name=f"{end}_truck",
        pos=[sign * geometry["wheelbase"].value / 2, 0.0, -geometry["truck_height"].value],
        mass=mass,
        ipos=_ORIGIN,
        inertia=_hanger_inertia(mass, track, radius),
        explicitinertial=True,
    )
    limit = 1.05 * steering_angle(min(tilt_range, math.pi / 2), geometry["rake"].value)
    truck.add_joint(
        name=f"{end}_truck_joint",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, 0.0, -sign],
        # A little more than the full tilt needs, so that it is the tilt joint that ends the motion.
        limited=mujoco.mjtLimited.mjLIMITED_TRUE
        if coupling == "equality"
        else mujoco.mjtLimited.mjLIMITED_FALSE,
        range=[-limit, limit],
        armature=_DIRECT_ARMATURE if coupling == "direct" else 0.0,
    )
    _visual(truck, f"{end}_hanger_visual", [0.012, track / 2 - 0.02, 0.012])
    for side, y in (("left", track / 2), ("right", -track / 2)):
        _add_wheel(
            truck, f"{end}_{side}", y, radius, STEERED_SHARE * board.mass["wheel"].value, wheel_friction
        )


def _add_wheel(
    truck: mujoco.MjsBody, name: str, y: float, radius: float, mass: float, friction: Sequence[float]
) -> None:
    """Add a wheel: a sphere to touch the ground, since a cylinder's two edges scrub when it steers."""
    wheel = truck.add_body(
        name=f"{name}_wheel",
        pos=[0.0, y, 0.0],
        mass=mass,
        ipos=_ORIGIN,
        inertia=_wheel_inertia(mass, radius),
        explicitinertial=True,
    )
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


def _add_coupling(spec: mujoco.MjSpec, board: Board, tilt_range: float, timestep: float) -> None:
    """Tie both trucks to the tilt, as stiffly as the step allows (MuJoCo wants two steps of time constant)."""
    coefficients, _ = coupling_polynomial(board.geometry["rake"].value, tilt_range)
    for joint in TRUCK_JOINTS:
        constraint = spec.add_equality(
            name=joint.replace("joint", "coupling"),
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=joint,
            name2=TILT_JOINT,
            solref=[2 * timestep, 1.0],
            solimp=[0.9999, 0.9999, 0.001, 0.5, 2.0],
        )
        constraint.data[:5] = coefficients


def deck_inertia(board: Board, roll: float) -> Array:
    """Return a deck's principal inertia [kg*m^2], shape (3,).

    As of a cuboid of the record's length, thickness and mass, and of the width that has the roll inertia.

    Args:
        board: The record.
        roll: Inertia about the tilt axis [kg*m^2].

    Raises:
        HuskyError: No deck of this thickness has so small a roll inertia.
    """
    length, thickness = board.geometry["length"].value, board.geometry["thickness"].value
    mass = board.mass["deck"].value
    if roll <= mass * thickness**2 / 12:
        raise HuskyError(
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
