"""A joint of a MuJoCo model as a record: everything that identifies a board's tilt joint then works on it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from sim.model.arc import Arc, walk
from sim.model.setup import Setup
from sysid.board import Board, BoardEffect
from sysid.effects import catalogue, effect, linkage, payload, weight
from sysid.effects._base import Effect
from sysid.effects._harmonics import HARMONICS, of_table
from sysid.quantity import Z95, Quantity
from sysid.recording import Recording
from sysid.roll import Array

ROUNDING = 1e-9
"""Rests nearer to a joint's zero are at it [rad or m]."""
MIN_WEIGHT_SHARE = 1e-9
"""Pull below this share of what the joint's inertia would feel as a point at 1 m is no weight."""
MAX_INERTIA_CHANGE = 1e-6
"""Change of the inertia along the arc, as a share, below which it is that of a rigid body."""
MAX_HARMONIC_ERROR = 0.01
"""Share of a table's largest value by which its harmonics may miss it unsaid."""


def board_of(setup: Setup, *, mass_error: float = 0.0) -> tuple[Board, list[str]]:
    """Return the record of a joint of a model, and what was found on the way, in words.

    Args:
        mass_error: Half-width of the 95 % interval of the model's masses, as a share: one factor for all.

    Raises:
        SysidError: The model cannot be read, or the joint is held by a loop.
    """
    spec = setup.load()
    joint = setup.joint_of(spec)
    arc = walk(setup, spec)
    slides = int(joint.type) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    angular = not slides and bool(spec.compiler.degree)
    stiffness = float(joint.stiffness[0])
    springref = math.radians(joint.springref) if angular else float(joint.springref)
    rest = springref if stiffness > 0 else hangs_at(arc, _position(setup, spec))
    inertia = arc.at(rest, arc.inertia)
    effects = [
        _effect(part, dict(zip(part.parameter_names, values, strict=True)))
        for part in catalogue().values()
        if (values := part.from_mjcf(joint))
    ]
    strongest = float(np.abs(arc.pull).max())
    own = arc.pull if not setup.payload else _without_payload(setup, arc)
    pull, missed = of_table(arc.position, own)
    if strongest > MIN_WEIGHT_SHARE * inertia:
        effects.append(_effect(weight.EFFECT, {"scale": 1.0, **pull}))
    if setup.payload:
        effects.append(_effect(payload.EFFECT, of_table(arc.position, arc.pull - own)[0]))
    changes, blurred = of_table(arc.position, arc.inertia - inertia)
    if np.ptp(arc.inertia) > MAX_INERTIA_CHANGE * inertia:
        effects.append(_effect(linkage.EFFECT, changes))
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
            "range": Quantity(float(np.abs(arc.position[[0, -1]] - rest).max()) or math.pi, 0.0, "rad"),
        },
        effects=tuple(effects),
        model=setup.entry(),
    )
    board = board.of_slide() if slides else board
    shares = {"weight": missed / max(strongest, 1e-300), "inertia": blurred / inertia}
    return board, [
        *_parts(arc, board, float(joint.armature), strongest),
        *_coarse(shares),
        *_acting(setup, spec),
    ]


def pose_releases(
    board: Board, recordings: Sequence[Recording], setups: Sequence[Setup]
) -> tuple[Board, list[Recording]]:
    """Return a record, as the joint mostly was, and recordings in several poses, or with several loads, for one fit of all."""
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
    """Return the parameters that differ from another record of the same joint, in another pose or with another payload, as `Release.known` takes them."""
    parts = {part.name: part.parameters for part in board.effects}
    known = {"inertia": board.inertia.value}
    for own in (weight.EFFECT.name, payload.EFFECT.name, linkage.EFFECT.name):
        for parameter in HARMONICS:
            known[f"{own}.{parameter}"] = parts[own][parameter].value if own in parts else 0.0
    return known


def hangs_at(arc: Arc, near: float) -> float:
    """Return where the weight lets the joint rest, nearest to a position [rad or m]; where it does nowhere, that position."""
    crossing = np.flatnonzero((arc.pull[:-1] > 0) & (arc.pull[1:] <= 0))
    if not len(crossing):
        return near
    i = min(crossing, key=lambda k: abs(arc.position[k] - near))
    (x, y), (p, q) = arc.position[i : i + 2], arc.pull[i : i + 2]
    rest = float(x + (y - x) * p / (p - q))
    return 0.0 if abs(rest) < ROUNDING else rest


def _without_payload(setup: Setup, arc: Arc) -> Array:
    """Return the pull of the model alone at the places of an arc [N*m or N], shape (n,)."""
    bare = setup.with_(payload=())
    alone = walk(bare, bare.load())
    return np.interp(arc.position, alone.position, alone.pull)


def _position(setup: Setup, spec: mujoco.MjSpec) -> float:
    model = spec.compile()
    return float(setup.posed(model)[model.jnt_qposadr[model.joint(setup.joint).id]])


def _effect(part: Effect, values: Mapping[str, float]) -> BoardEffect:
    return BoardEffect(part.name, {p.name: Quantity(values[p.name], 0.0, p.unit) for p in part.parameters})


def _parts(arc: Arc, board: Board, armature: float, strongest: float) -> list[str]:
    """Say what the joint moves, and what pulls at it."""
    unit, force, place = ("kg", "N", "m") if board.slides else ("kg·m²", "N·m", "rad")
    notes = [
        f"inertia {board.inertia.value:.4g} {unit} at the rest {board.rest_angle:.4g} {place}, of which armature {armature:.4g}; "
        + (f"carries along: {', '.join(arc.carried)}" if arc.carried else "all other joints held"),
        f"weight and other springs pull with up to {strongest:.4g} {force}: known from the model, not fitted"
        if strongest > MIN_WEIGHT_SHARE * board.inertia.value
        else "no weight pulls at it",
    ]
    if arc.loose:
        notes.append(
            "free joints follow by their inertia alone, as they do in the first moments: where they swing by themselves, hold "
            "them in the measurement"
        )
    change = float(np.ptp(arc.inertia)) / board.inertia.value
    if change > MAX_HARMONIC_ERROR:
        notes.append(
            f"along its way the inertia changes by {100 * change:.0f} %, as the model says; the law has it"
        )
    return notes


def _coarse(shares: Mapping[str, float]) -> list[str]:
    return [
        f"its {what} is known to {100 * share:.0f} % of its largest value only: it bends more than three harmonics do"
        for what, share in shares.items()
        if share > MAX_HARMONIC_ERROR
    ]


def _acting(setup: Setup, spec: mujoco.MjSpec) -> list[str]:
    """Say what acts on the joint beside what the law has."""
    model = spec.compile()
    number = model.joint(setup.joint).id
    kinds = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    notes = [
        f"actuator '{model.actuator(i).name}' acts on it: off in the law and in `check`, as in a measurement without power"
        for i in range(model.nu)
        if int(model.actuator_trntype[i]) in kinds and int(model.actuator_trnid[i, 0]) == number
    ]
    for tendon in range(model.ntendon):
        first = int(model.tendon_adr[tendon])
        wraps = range(first, first + int(model.tendon_num[tendon]))
        joints = [
            int(model.wrap_objid[w])
            for w in wraps
            if int(model.wrap_type[w]) == int(mujoco.mjtWrap.mjWRAP_JOINT)
        ]
        if number in joints and (model.tendon_damping[tendon] or model.tendon_frictionloss[tendon]):
            notes.append(
                f"tendon '{model.tendon(tendon).name}' damps it beside its own damper: what is fitted holds both, and the patched "
                "copy would have it twice. Take the tendon's out first"
            )
    return notes
