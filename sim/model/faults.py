"""Properties of a model that falsify a fit of its joint: reported before the fit, and numbers that are refused after it."""

from collections.abc import Collection

import mujoco
import numpy as np

from sim.model.arc import walk
from sim.model.setup import Setup
from sim.model.subject import rest_of, servos_of
from sysid.board import Board
from sysid.errors import SysidError
from sysid.text import display

DISABLED = {
    "mjDSBL_CONSTRAINT": ("constraint", "frictionloss, limits and loops do nothing", {"frictionloss"}),
    "mjDSBL_FRICTIONLOSS": ("frictionloss", "frictionloss does nothing", {"frictionloss"}),
    "mjDSBL_LIMIT": ("limit", "limits do nothing", set[str]()),
    "mjDSBL_EQUALITY": ("equality", "loops do nothing", set[str]()),
    "mjDSBL_SPRING": ("spring", "stiffness does nothing", {"stiffness"}),
    "mjDSBL_DAMPER": ("damper", "damping does nothing", {"damping"}),
    "mjDSBL_PASSIVE": ("passive", "stiffness and damping do nothing", {"stiffness", "damping"}),
    "mjDSBL_GRAVITY": ("gravity", "nothing has a weight", set[str]()),
}
"""MuJoCo's flags: the name in MJCF, the consequence, and the attributes of a joint that it switches off."""


def disabled(spec: mujoco.MjSpec, attributes: Collection[str] | None = None) -> list[str]:
    """Return a warning for each flag of a model that switches off one of these attributes; for every flag if None."""
    given = int(spec.option.disableflags)
    bits = mujoco.mjtDisableBit.__members__
    return [
        f'{consequence} here: the model has <flag {flag}="disable"/>. Delete that flag, or fit without these parts'
        for name, (flag, consequence, off) in DISABLED.items()
        if name in bits and given & int(bits[name]) and (attributes is None or off & {*attributes})
    ]


def warnings_of(setup: Setup) -> list[str]:
    """Return warnings on a model before its joint is fitted: switched-off physics, and a rest on a limit.

    Raises:
        SysidError: The model cannot be read.
    """
    spec = setup.load()
    return [*disabled(spec), *pressed(setup, spec)]


def pressed(setup: Setup, spec: mujoco.MjSpec) -> list[str]:
    """Return a warning where weight and springs press the joint against the end of its range."""
    arc, joint = walk(setup, spec), setup.joint_of(spec)
    rest, stiffness = rest_of(setup, spec, arc), float(joint.stiffness[0])
    torque = arc.pull - stiffness * (arc.position - rest)
    balanced = np.any((torque[:-1] >= 0) & (torque[1:] <= 0))
    if arc.closed or balanced or not np.any(torque) or len(arc.position) < 2:
        return []
    pressed = [end for end, out in ((0, -torque[0]), (-1, torque[-1])) if out > 0]
    end = min(pressed, key=lambda one: abs(arc.position[one] - rest))
    is_slide = int(joint.type) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    show = display(is_rate=False, slides=is_slide)
    return [
        f"the model rests against the end of its range at {show(float(arc.position[end]))}: weight and springs press it there with "
        f"{abs(torque[end]):.3g} {'N' if is_slide else 'N·m'}. The law has no limit, so a release that touches it misleads the fit. "
        "Correct the range or the pose of the model, or fit the missing spring (--bound stiffness=0:...)"
    ]


def refuse_unphysical(setup: Setup, joint: mujoco.MjsJoint, board: Board) -> None:
    """Check that a fitted joint is physical before it is written.

    Raises:
        SysidError: Armature, damping, dry friction or stiffness is negative; the message names the likely cause.
    """
    numbers = {
        "armature (the rotor's inertia)": float(joint.armature),
        "damping of the joint alone": float(joint.damping[0]),
        "dry friction of the joint alone": float(joint.frictionloss),
        "stiffness": float(joint.stiffness[0]),
    }
    negative = [f"{name} {value:.4g}" for name, value in numbers.items() if value < 0]
    if not negative:
        return
    holding = [servo for servo in servos_of(setup, setup.load()) if servo.stiffness or servo.damping]
    cause = (
        f"Was {' and '.join(servo.text(slides=board.slides) for servo in holding)} on in the measurement? Record the joint without power"
        if holding
        else "A torque that the model lacks moved the joint: a powered motor, a spring, a cable, or joints that the model brakes "
        "too much. Record it without power, or fit the spring (--bound stiffness=0:...)"
    )
    raise SysidError(f"not physical, so nothing is written: {', '.join(negative)}. {cause}.")
