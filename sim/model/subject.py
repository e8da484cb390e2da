"""A joint of a MuJoCo model as a record: everything that identifies a board's tilt joint then works on it."""

import math

import mujoco
import numpy as np

from sim.model.arc import Arc, walk
from sim.model.setup import Setup
from sysid.board import Board, BoardEffect
from sysid.effects import catalogue, weight
from sysid.quantity import Z95, Quantity

WORTH = 1e-9
"""Pull below this share of what the joint's inertia would feel as a point at 1 m is no weight."""
VARIES = 0.01
"""Change of the inertia along the arc from which it is said: the law takes it as constant."""


def board_of(setup: Setup, *, name: str = "", mass_error: float = 0.0) -> tuple[Board, list[str]]:
    """Return the record of a joint of a model, and what was found on the way, in words.

    Args:
        setup: Which joint, and how it was measured.
        name: Of the record; made of file and joint if left out.
        mass_error: Half-width of the 95 % interval of the model's masses, as a share: one factor for all.

    Raises:
        SysidError: The model cannot be read, or the joint is held by a loop.
    """
    spec = setup.load()
    joint = setup.joint_of(spec)
    arc = walk(setup, spec)
    slides = int(joint.type) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    angular = not slides and bool(spec.compiler.degree)
    reference = math.radians(joint.springref) if angular else float(joint.springref)
    effects = [
        BoardEffect(
            part.name,
            {p.name: Quantity(v, 0.0, p.unit) for p, v in zip(part.parameters, values, strict=True)},
        )
        for part in catalogue().values()
        if (values := part.from_mjcf(joint))
    ]
    pull, missed = weight.of_table(arc.position, arc.pull)
    stiffness, damping = float(joint.stiffness[0]), float(joint.damping[0])
    rest = reference if stiffness > 0 else _hangs_at(arc, setup, spec)
    inertia = arc.at(rest, arc.inertia)
    if np.abs(arc.pull).max() > WORTH * inertia:
        own = weight.EFFECT
        effects.append(
            BoardEffect(own.name, {p.name: Quantity(pull[p.name], 0.0, p.unit) for p in own.parameters})
        )
    ends = [float(spec_end) for spec_end in (arc.position[0], arc.position[-1])]
    board = Board(
        name=name or f"{setup.file.stem}_{setup.joint}".replace("/", "_"),
        description=f"joint '{setup.joint}' of {setup.file.name}",
        source=str(setup.file),
        geometry={},
        mass={},
        inertia=Quantity(
            inertia,
            inertia * mass_error / Z95,
            "kg*m^2",
            f"mass matrix of {setup.file.name}, armature included",
        ),
        tilt={
            "stiffness": Quantity(stiffness, 0.0, "N*m/rad"),
            "damping": Quantity(damping + arc.at(rest, arc.damping), 0.0, "N*m*s/rad"),
            "rest_angle": Quantity(rest, 0.0, "rad"),
            "range": Quantity(max(abs(end - rest) for end in ends) or math.pi, 0.0, "rad"),
        },
        effects=tuple(effects),
        model=setup.entry(),
    )
    notes = _notes(setup, spec, joint, arc, board, missed)
    return (board.of_slide() if slides else board), notes


def known_of(setup: Setup) -> dict[str, float]:
    """Return what is other than in the record for releases of another pose or payload, as `Release.known` takes it."""
    board, _ = board_of(setup)
    own = weight.EFFECT.name
    pull = next((part.parameters for part in board.effects if part.name == own), None)
    known = {"inertia": board.inertia.value}
    if board.stiffness == 0:
        known["rest_angle"] = board.rest_angle
    for parameter in weight.HARMONICS:
        known[f"{own}.{parameter}"] = 0.0 if pull is None else pull[parameter].value
    return known


def _hangs_at(arc: Arc, setup: Setup, spec: mujoco.MjSpec) -> float:
    """Return where the weight lets the joint rest; where it does not, the pose itself."""
    crossing = np.flatnonzero((arc.pull[:-1] > 0) & (arc.pull[1:] <= 0))
    model = spec.compile()
    here = float(setup.posed(model)[model.jnt_qposadr[model.joint(setup.joint).id]])
    if not len(crossing):
        return here
    i = min(crossing, key=lambda k: abs(arc.position[k] - here))
    (x, y), (p, q) = arc.position[i : i + 2], arc.pull[i : i + 2]
    return float(x + (y - x) * p / (p - q))


def _notes(
    setup: Setup, spec: mujoco.MjSpec, joint: mujoco.MjsJoint, arc: Arc, board: Board, missed: float
) -> list[str]:
    """Say what the record was made of, and what the law leaves out."""
    model = spec.compile()
    strongest, rest = float(np.abs(arc.pull).max()), board.rest_angle
    notes = [
        f"inertia {board.inertia.value:.4g} at the rest {rest:.4g}, of which armature {joint.armature:.4g}; "
        + (f"carries along: {', '.join(arc.carried)}" if arc.carried else "all other joints held"),
        f"weight and other springs pull with up to {strongest:.4g}: known from the model, not fitted"
        if strongest > WORTH * board.inertia.value
        else "no weight pulls at it",
    ]
    if arc.loose:
        notes.append(
            "free joints follow by their inertia alone, as they do in the first moments: where they swing by themselves, hold "
            "them in the measurement"
        )
    change = float(np.ptp(arc.inertia)) / board.inertia.value
    if change > VARIES:
        notes.append(
            f"along its way the inertia changes by {100 * change:.0f} %, which the law takes as constant: small swings about "
            "the rest are right, and `check` moves the model itself"
        )
    if missed > VARIES * strongest:
        notes.append(f"the weight is tabulated to {100 * missed / strongest:.0f} % of its largest value only")
    notes += [
        f"{what} acts on it: off in the law and in `check`, as in a measurement without power"
        for what in _actuators(model, setup.joint)
    ]
    number = model.joint(setup.joint).id
    for tendon in range(model.ntendon):
        first = int(model.tendon_adr[tendon])
        wraps = range(first, first + int(model.tendon_num[tendon]))
        on_joint = any(int(model.wrap_objid[w]) == number and int(model.wrap_type[w]) == 1 for w in wraps)
        if on_joint and (model.tendon_damping[tendon] or model.tendon_frictionloss[tendon]):
            notes.append(
                f"tendon '{model.tendon(tendon).name}' damps it beside its own damper: the fitted damping holds both"
            )
    return notes


def _actuators(model: mujoco.MjModel, joint: str) -> list[str]:
    """Return the actuators of a joint, in words."""
    number = model.joint(joint).id
    kinds = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    return [
        f"actuator '{model.actuator(i).name}'"
        for i in range(model.nu)
        if int(model.actuator_trntype[i]) in kinds and int(model.actuator_trnid[i, 0]) == number
    ]
