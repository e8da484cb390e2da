"""The free board as MJCF: deck on a sprung tilt joint, steered trucks, wheels, ground. Its bench has the deck alone.

The bodies are in `sim.board.bodies`. Every joint is positive in a right turn. `board_tilt_joint` is the roll, right edge down.
Both truck joints are the steering angle σ of tan σ = tan λ sin roll: the front truck turns right, the rear one left.
"""

import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from sim.board.bodies import (
    TILT_JOINT,
    TRUCK_JOINTS,
    WHEELS,
    Coupling,
    add_body,
    add_chassis,
    add_deck,
    add_truck,
    deck_inertia,
    law_of,
    reflected_inertia,
    steering_angle,
    wheel_friction,
)
from sysid.board import Board
from sysid.errors import SysidError
from sysid.quantity import GRAVITY, Quantity
from sysid.roll import Array


def board_spec(
    board: Board, *, coupling: Coupling = "equality", ground: bool = True, timestep: float = 0.005,
    integrator: str = "implicitfast", friction: Sequence[float] | None = None,
) -> mujoco.MjSpec:  # fmt: skip
    """Build the free board from its record, effects included.

    Args:
        board: The record; its masses, roll inertia, stiffness, damping and effects are built.
        coupling: How tilt steers the trucks. With 'equality' the inertia of the steered parts is taken off the deck's.
        ground: Whether to add the ground and a light. Without them the spec is an entity for another scene, whose options
            count.
        timestep: Step of the scene [s]; it limits the stiffness of the coupling.
        friction: Sliding [1], torsional [m] and rolling [m] friction of the wheels; the record's if None.

    Raises:
        SysidError: The inertia is too small for the deck's mass, rake and tilt range contradict each other, or compiled mass or
            inertia differ from the record.
    """
    board.need("the scene of the whole board")
    spec = mujoco.MjSpec()
    spec.modelname = board.name
    spec.compiler.degree = False
    if ground:
        spec.option.timestep = timestep
        spec.option.integrator = integrator_value(integrator)
        _add_ground(spec)
    limit = board.tilt["range"].value
    root = add_chassis(spec, board)
    reflected = reflected_inertia(board) if coupling == "equality" else 0.0
    # Steered parts must not count twice; an effect that scales the inertia multiplies the number written here.
    tilt = add_deck(root, board, board.inertia.value - reflected / law_of(board).inertia_gain, limit)
    for end in ("front", "rear"):
        add_truck(root, board, end, limit, coupling, friction or wheel_friction(board))
    for wheel in WHEELS:
        # A deck at full tilt would touch its wheels; a real board has risers.
        spec.add_exclude(name=f"deck_{wheel}_wheel", bodyname1="deck", bodyname2=f"{wheel}_wheel")
    if coupling == "equality":
        _add_coupling(spec, board, limit, timestep)
    add_effects(spec, tilt, board)
    assert_matches_record(spec, board, coupling)
    return spec


def rig_spec(board: Board, *, timestep: float = 0.001, integrator: str = "implicitfast") -> mujoco.MjSpec:
    """Build the clamped bench from a board record: the deck on its tilt joint, without a limit, and nothing else.

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


def set_trucks(model: mujoco.MjModel, data: mujoco.MjData, rake: float, prefix: str = "") -> None:
    """Set both truck joints from the tilt, position and velocity: the `direct` coupling.

    To be called after every step (and after every reset) of a scene built with coupling='direct'.

    Args:
        rake: λ of tan σ = tan λ sin roll [rad].
    """
    tilt = model.joint(prefix + TILT_JOINT)
    roll, rate = float(data.qpos[tilt.qposadr[0]]), float(data.qvel[tilt.dofadr[0]])
    angle = steering_angle(roll, rake)
    speed = rate * math.tan(rake) * math.cos(roll) * math.cos(angle) ** 2
    for name in TRUCK_JOINTS:
        truck = model.joint(prefix + name)
        data.qpos[truck.qposadr[0]] = angle
        data.qvel[truck.dofadr[0]] = speed


def coupling_polynomial(rake: float, tilt_range: float) -> Array:
    """Fit σ ≈ a roll + b roll³ to tan σ = tan λ sin roll over ± `tilt_range` [rad]: coefficients for `polycoef`, shape (5,).

    MuJoCo's joint equality takes a polynomial of up to the fourth degree; the law is odd.
    """
    roll = tilt_range * np.sin(np.linspace(-np.pi / 2, np.pi / 2, 201))  # dense at the ends, as Chebyshev's
    angle = np.arctan(np.tan(rake) * np.sin(roll))
    basis = np.stack([roll, roll**3], axis=1)
    (linear, cubic), *_ = np.linalg.lstsq(basis, angle, rcond=None)
    return np.array([0.0, linear, 0.0, cubic, 0.0])


def integrator_value(name: str) -> int:
    """Return MuJoCo's number of an integrator, as MJCF names it."""
    return int(mujoco.mjtIntegrator.__members__[f"mjINT_{name.upper()}"])


def integrator_name(model: mujoco.MjModel) -> str:
    """Return the name of a model's integrator, as MJCF gives it."""
    name = str(mujoco.mjtIntegrator(model.opt.integrator).name).removeprefix("mjINT_")
    return {"EULER": "Euler", "RK4": "RK4"}.get(name, name.lower())


def add_effects(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, board: Board) -> tuple[str, ...]:
    """Put spring, damper and effects of a record on a tilt joint, in place; return a line for each part written."""
    joint.stiffness[0] = board.stiffness
    joint.damping[0] = board.damping
    joint.springref = board.rest_angle
    if not board.effects:
        return ()
    from sysid.effects import effect  # only boards with effects need the catalogue

    # A support moves everything that the joint carries: it comes last.
    parts = sorted(board.effects, key=lambda part: effect(part.name).role == "support")
    lines: list[str] = []
    for part in parts:
        values = {name: quantity.value for name, quantity in part.parameters.items()}
        lines += effect(part.name).to_mjcf(spec, joint, values)
    deck = joint.parent
    # A deck of less roll inertia is narrower, and turns more easily about z too.
    deck.inertia[2] = min(deck.inertia[2], 0.999 * (deck.inertia[0] + deck.inertia[1]))
    return tuple(lines)


def assert_matches_record(spec: mujoco.MjSpec, board: Board, coupling: Coupling) -> None:
    """Compile the spec and compare total mass and roll inertia about the tilt axis with the record.

    MuJoCo may compile something else than was meant: geoms add mass where an inertial is missing, or a deck's inertia counts
    twice.

    Raises:
        SysidError: They differ.
    """
    model = spec.compile()
    expected = board.mass["deck"].value + 2 * board.mass["truck"].value + 4 * board.mass["wheel"].value
    weight = float(model.body_mass.sum())
    if not math.isclose(weight, expected, rel_tol=1e-3):  # a support that an effect adds weighs a gram
        raise SysidError(
            f"board '{board.name}': the compiled board weighs {weight:.6g} kg, its record says {expected:.6g} kg."
        )
    assert_roll_inertia(model, board, board.geometry if coupling == "equality" else None)


def assert_roll_inertia(
    model: mujoco.MjModel, board: Board, geometry: Mapping[str, Quantity] | None = None
) -> None:
    """Compare `roll_inertia` with the record.

    Raises:
        SysidError: They differ.
    """
    inertia = roll_inertia(model, geometry)
    recorded = law_of(board).inertia_ratio * board.inertia.value
    if not math.isclose(inertia, recorded, rel_tol=1e-6):
        raise SysidError(
            f"board '{board.name}': the compiled roll inertia is {inertia:.6g} kg*m^2, the record says "
            f"{recorded:.6g} kg*m^2."
        )


def roll_inertia(model: mujoco.MjModel, geometry: Mapping[str, Quantity] | None = None) -> float:
    """Return the compiled inertia about the tilt axis [kg*m^2], the chassis held.

    Args:
        geometry: The board's, to include steered trucks (angle × tan λ) and their wheels, which roll without slip.
    """
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    motion = np.zeros(model.nv)  # of all joints, for a roll rate of 1 rad/s
    motion[model.joint(TILT_JOINT).dofadr[0]] = 1.0
    hinge = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, f"{TILT_JOINT}_hanging_joint")
    if hinge >= 0:  # a hanging body does not turn with the deck
        motion[model.jnt_dofadr[hinge]] = -1.0
    if geometry is not None:
        steer = math.tan(geometry["rake"].value)
        roll = steer * geometry["track"].value / 2 / geometry["wheel_radius"].value
        for name in TRUCK_JOINTS:
            motion[model.joint(name).dofadr[0]] = steer
        for name in WHEELS:
            left, front = name.endswith("left"), name.startswith("front")
            motion[model.joint(f"{name}_wheel_joint").dofadr[0]] = roll if left == front else -roll
    return float(motion @ inertia @ motion)


def _add_ground(spec: mujoco.MjSpec) -> None:
    spec.stat.extent = 0.8  # first view
    spec.stat.center = [0.0, 0.0, 0.05]
    spec.worldbody.add_geom(
        name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5.0, 5.0, 0.1], rgba=[0.32, 0.36, 0.40, 1.0]
    )
    spec.worldbody.add_light(
        name="sun", type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, pos=[0.0, 0.0, 3.0], dir=[0.2, 0.3, -1.0],
        castshadow=False,
    )  # fmt: skip


def _add_coupling(spec: mujoco.MjSpec, board: Board, tilt_range: float, timestep: float) -> None:
    """Tie both trucks to the tilt, as stiffly as the step allows (MuJoCo wants two steps of time constant)."""
    coefficients = coupling_polynomial(board.geometry["rake"].value, tilt_range)
    for joint in TRUCK_JOINTS:
        constraint = spec.add_equality(
            name=joint.replace("joint", "coupling"), type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=joint, name2=TILT_JOINT, solref=[2 * timestep, 1.0],
            solimp=[0.9999, 0.9999, 0.001, 0.5, 2.0],
        )  # fmt: skip
        constraint.data[:5] = coefficients


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
