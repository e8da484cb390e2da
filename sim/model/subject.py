"""A joint of a MuJoCo model as a record, which every command takes as it takes a board."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sim.model import urdf
from sim.model.arc import REACH, Arc, walk
from sim.model.setup import Setup
from sysid.board import Board, BoardEffect
from sysid.effects import catalogue, coulomb, effect, linkage, linked_spring, payload, weight
from sysid.effects._base import Effect
from sysid.effects._harmonics import HARMONICS, of_table
from sysid.quantity import Z95, Quantity
from sysid.recording import Recording
from sysid.roll import Array

TINY = 1e-9
"""Rounding: a rest nearer to zero is zero [rad or m]; a torque smaller by this factor than the inertia's unit is no torque."""
MAX_ERROR = 0.01
"""Error of a table's harmonics, and change of an inertia along the arc, above which a note is printed [1]. Masses are usually known to a per cent."""
SMALL = 1e-3
"""Displacement and rate by which an actuator is probed [rad or m, and per second]."""


@dataclass(frozen=True, slots=True)
class Servo:
    """One actuator on the joint, without a command."""

    name: str
    stiffness: float
    """[N*m/rad or N/m]."""
    damping: float
    """[N*m*s/rad or N*s/m]."""

    def text(self, *, slides: bool) -> str:
        """Return its name and numbers, for messages."""
        units = ("N/m", "N·s/m") if slides else ("N·m/rad", "N·m·s/rad")
        sizes = zip(("holds with", "brakes with"), (self.stiffness, self.damping), units, strict=True)
        words = [f"{word} {size:.4g} {unit}" for word, size, unit in sizes if size]
        return f"actuator '{self.name}'" + (f" ({', '.join(words)})" if words else "")


def servos_of(setup: Setup, spec: mujoco.MjSpec) -> list[Servo]:
    """Return the actuators that act on the joint in its pose, through whichever transmission."""
    model = spec.compile()
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    joint = model.joint(setup.joint)
    dof, where = int(joint.dofadr[0]), int(joint.qposadr[0])
    pose, forces, moment = setup.posed(model), [], np.zeros((model.nu, model.nv))
    for q, v in ((0.0, 0.0), (SMALL, 0.0), (0.0, SMALL)):
        data = mujoco.MjData(model)
        data.qpos[:] = pose
        data.qpos[where] += q
        data.qvel[dof] = v
        mujoco.mj_forward(model, data)
        if model.nu:
            mujoco.mju_sparse2dense(
                moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
            )
        forces.append(moment[:, dof] * data.actuator_force)
    still, moved, fast = np.array(forces)
    return [
        Servo(
            model.actuator(i).name or str(i),
            *(float(f"{x:.6g}") for x in ((still - moved)[i] / SMALL, (still - fast)[i] / SMALL)),
        )
        for i in np.flatnonzero(np.abs(moment[:, dof]) > 0)
    ]


def board_of(setup: Setup, *, mass_error: float = 0.0) -> tuple[Board, list[str]]:
    """Return the record of a joint of a model, and notes on the model's facts.

    Args:
        mass_error: Half-width of the 95 % interval of the model's masses, as a share: one factor for all.

    Raises:
        SysidError: The model cannot be read, or a loop holds the joint.
    """
    spec = setup.load()
    joint = setup.joint_of(spec)
    arc = walk(setup, spec)
    is_slide = int(joint.type) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    stiffness, rest = float(joint.stiffness[0]), rest_of(setup, spec, arc)
    inertia = arc.at(rest, arc.inertia)
    effects, missed = _effects(setup, spec, arc, rest)
    reach = 0.0 if arc.closed else float(np.abs(arc.position[[0, -1]] - rest).max())
    board = Board(
        name=f"{setup.file.stem}_{setup.joint}".replace("/", "_"),
        description=f"joint '{setup.joint}' of {setup.file.name}",
        source=str(setup.file),
        inertia=Quantity(
            inertia,
            inertia * mass_error / Z95,
            "kg*m^2",
            f"mass matrix of {setup.file.name}, armature included",
        ),
        tilt={
            "stiffness": Quantity(stiffness, 0.0, "N*m/rad"),
            "damping": Quantity(float(joint.damping[0]) + arc.at(rest, arc.damping), 0.0, "N*m*s/rad"),
            "rest_angle": Quantity(rest, 0.0, "rad"),
            "range": Quantity(reach or math.pi, 0.0, "rad"),
        },
        effects=effects,
        model=setup.entry(),
    )
    board = board.of_slide() if is_slide else board
    return board, [
        *_parts(arc, board, float(joint.armature), float(np.abs(arc.weight).max())),
        *_beside(arc, board),
        *(
            f"{servo.text(slides=is_slide)} acts on it: off in the law and in `check`, as in a measurement without power"
            for servo in servos_of(setup, spec)
        ),
        *([urdf.NOTE] if setup.is_urdf else []),
        *(
            f"three harmonics state its {name} to {100 * share:.0f} % of the largest value only"
            for name, share in missed.items()
            if share > MAX_ERROR
        ),
    ]


def _effects(
    setup: Setup, spec: mujoco.MjSpec, arc: Arc, rest: float
) -> tuple[tuple[BoardEffect, ...], dict[str, float]]:
    """Return the effects that a model states of a joint, and the errors of their harmonics as shares [1]."""
    joint, inertia = setup.joint_of(spec), arc.at(rest, arc.inertia)
    effects = [
        _effect(part, dict(zip(part.parameter_names, values, strict=True)))
        for part in catalogue().values()
        if (values := part.from_mjcf(joint))
    ]
    if friction := arc.at(rest, arc.friction):
        effects = _with_friction(effects, friction)
    own = arc.weight if not setup.payload else _without_payload(setup, arc)
    spring, held = _spring(arc)
    if spring["stiffness"]:
        effects.append(_effect(linked_spring.EFFECT, spring))
    strongest = float(np.abs(arc.pull).max())
    weighs, missed = of_table(arc.position, own + arc.springs - held)
    if missed > MAX_ERROR * strongest:  # a spatial tendon: exact near the rest only
        near = np.abs(arc.position - rest) < REACH["hinge"] / 2
        weighs, missed = of_table(arc.position[near], (own + arc.springs - held)[near])
    if any(weighs.values()) and strongest > TINY * inertia:
        effects.append(_effect(weight.EFFECT, {"scale": 1.0, **weighs}))
    if setup.payload:
        effects.append(_effect(payload.EFFECT, of_table(arc.position, arc.weight - own)[0]))
    changes, blurred = of_table(arc.position, arc.inertia - inertia)
    if np.ptp(arc.inertia) > 1e3 * TINY * inertia:
        effects.append(_effect(linkage.EFFECT, changes))
    missing = {"weight": missed / max(strongest, 1e-300), "inertia": blurred / inertia}
    return tuple(effects), missing


def pose_releases(
    board: Board, recordings: Sequence[Recording], setups: Sequence[Setup]
) -> tuple[Board, list[Recording]]:
    """Return a record and recordings of several poses or payloads for one fit of all."""
    records = [board_of(setup)[0] for setup in setups]
    posed = [
        replace(
            recording, releases=tuple(replace(release, known=known_of(one)) for release in recording.releases)
        )
        for recording, one in zip(recordings, records, strict=True)
    ]
    names = {part.name for part in board.effects}
    more = {
        part.name: part
        for one in records
        for part in one.effects
        if effect(part.name).is_known and part.name not in names
    }
    unpulled = (
        BoardEffect(
            name, {key: replace(q, value=float(key == "scale")) for key, q in part.parameters.items()}
        )
        for name, part in more.items()
    )
    return replace(board, effects=(*board.effects, *unpulled)), posed


def known_of(board: Board) -> dict[str, float]:
    """Return the parameters that a pose or a payload changes, as `Release.known` takes them."""
    parts = {part.name: part.parameters for part in board.effects}
    known = {"inertia": board.inertia.value}
    for own in (weight.EFFECT, payload.EFFECT, linkage.EFFECT, linked_spring.EFFECT):
        for name in own.parameter_names if own is linked_spring.EFFECT else HARMONICS:
            known[f"{own.name}.{name}"] = parts[own.name][name].value if own.name in parts else 0.0
    return known


def rest_of(setup: Setup, spec: mujoco.MjSpec, arc: Arc) -> float:
    """Return the rest of the joint's own spring, or without one the stable equilibrium nearest to the pose [rad or m].

    A joint that weight presses against a limit rests there. A joint without any torque rests in its pose.
    """
    joint = setup.joint_of(spec)
    if joint.stiffness[0] > 0:
        return math.radians(joint.springref) if in_degrees(spec, joint) else float(joint.springref)
    model = spec.compile()
    near = float(setup.posed(model)[model.jnt_qposadr[model.joint(setup.joint).id]])
    position, pull = arc.position, arc.pull
    if np.abs(pull).max() < TINY * arc.inertia.max():
        return near
    if arc.closed:  # the ends are one place: look beyond it
        position, pull = np.append(position, position[1:] + 2 * np.pi), np.append(pull, pull[1:])
    crossing = np.flatnonzero((pull[:-1] > 0) & (pull[1:] <= 0))
    gaps = np.diff(position)[crossing] / (pull[crossing] - pull[crossing + 1])
    rests = [float(rest) for rest in position[crossing] + gaps * pull[crossing]]
    if arc.closed:
        rests += [rest - 2 * np.pi for rest in rests]
    elif not rests:
        rests = [
            float(end) for end, out in zip(position[[0, -1]], (-pull[0], pull[-1]), strict=True) if out > 0
        ]
    rest = min(rests, key=lambda one: (round(abs(one - near), 6), -one), default=near)
    return 0.0 if abs(rest) < TINY else rest


def in_degrees(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> bool:
    """Return whether the file writes this joint's angles in degrees."""
    return bool(spec.compiler.degree) and int(joint.type) == int(mujoco.mjtJoint.mjJNT_HINGE)


def _spring(arc: Arc) -> tuple[dict[str, float], Array]:
    """Return the parameters of the spring with a slack range that the springs' torque is, and its torque, shape (n,).

    Both are zero where no such spring fits: a spatial tendon pulls by its geometry.
    """
    from scipy.optimize import least_squares

    x, torque = arc.position, arc.springs
    none, largest = {"stiffness": 0.0, "low": 0.0, "high": 0.0}, float(np.abs(torque).max())
    if largest < TINY or np.ptp(x) < TINY:
        return none, np.zeros_like(torque)

    def spring(numbers: Array) -> Array:
        stiffness, middle, half = numbers
        return -stiffness * np.sign(x - middle) * np.maximum(np.abs(x - middle) - abs(half), 0.0)

    slope = -float(np.polyfit(x, torque, 1)[0])
    middle = float(x[np.abs(torque).argmin()])
    fits = [least_squares(lambda n: spring(n) - torque, [slope, middle, half]) for half in (0.0, 0.3)]  # pyright: ignore[reportUnknownLambdaType]
    best = min(fits, key=lambda fit: fit.cost * (1 + abs(fit.x[2])) + TINY**2 * abs(fit.x[2]))
    stiffness, middle, half = (float(value) for value in best.x)
    half = abs(half) if abs(half) > 1e-6 else 0.0
    found = spring(np.array([stiffness, middle, half]))
    if np.abs(found - torque).max() > MAX_ERROR * largest:
        return none, np.zeros_like(torque)
    numbers = {"stiffness": stiffness, "low": middle - half, "high": middle + half}
    return {name: round(value, 9) + 0.0 for name, value in numbers.items()}, found


def _with_friction(effects: list[BoardEffect], more: float) -> list[BoardEffect]:
    """Return effects with dry friction that the joint's own attribute does not hold [N*m or N]."""
    part = coulomb.EFFECT
    own = sum(q.value for one in effects if one.name == part.name for q in one.parameters.values())
    return [*(one for one in effects if one.name != part.name), _effect(part, {"torque": own + more})]


def _without_payload(setup: Setup, arc: Arc) -> Array:
    """Return the weight of the model alone along an arc [N*m or N], shape (n,)."""
    bare = setup.with_(payload=())
    alone = walk(bare, bare.load())
    return np.interp(arc.position, alone.position, alone.weight)


def _effect(part: Effect, values: Mapping[str, float]) -> BoardEffect:
    return BoardEffect(part.name, {p.name: Quantity(values[p.name], 0.0, p.unit) for p in part.parameters})


def _parts(arc: Arc, board: Board, armature: float, strongest: float) -> list[str]:
    """Return notes on inertia and weight."""
    unit, force, place = ("kg", "N", "m") if board.slides else ("kg·m²", "N·m", "rad")
    notes = [
        f"inertia {board.inertia.value:.4g} {unit} at the rest {board.rest_angle:.4g} {place}, of which armature {armature:.4g}; "
        + (f"carries along: {', '.join(arc.carried)}" if arc.carried else "all other joints held"),
        f"weight: up to {strongest:.4g} {force}, known from the model, not fitted"
        if strongest > TINY * board.inertia.value
        else "no weight pulls at it",
    ]
    if arc.loose:
        notes.append(
            "free joints follow by their inertia alone, as in the first moments of a release. Hold them where they swing by themselves"
        )
    change = float(np.ptp(arc.inertia)) / board.inertia.value
    if change > MAX_ERROR:
        notes.append(f"its inertia changes by {100 * change:.0f} % along the arc, as the model states")
    return notes


def _beside(arc: Arc, board: Board) -> list[str]:
    """Return notes on tendons and carried joints that spring or brake the joint: known, and kept as they are."""
    force, turn = ("N", "m") if board.slides else ("N·m", "rad")
    rest, spring = board.rest_angle, _spring(arc)[0]
    strongest = float(np.abs(arc.springs).max())
    found = {
        f"spring {spring['stiffness']:.4g} {force}/{turn}": spring["stiffness"],
        f"springs up to {strongest:.4g} {force}": 0.0 if spring["stiffness"] else round(strongest, 9),
        f"damping {arc.at(rest, arc.damping):.4g} {force}·s/{turn}": arc.at(rest, arc.damping),
        f"dry friction {arc.at(rest, arc.friction):.4g} {force}": arc.at(rest, arc.friction),
    }
    parts = [text for text, value in found.items() if value]
    return [f"tendons and carried joints of the model: {', '.join(parts)}; kept as they are"] if parts else []
