"""A bumper on one side."""

from dataclasses import replace

from sysid.effects import end_stop
from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect
from sysid.effects._mjcf import UNREACHABLE_TILT

NEAREST = 1e-6
"""Least angle of a stop [rad]: the ramp of the damper is a share of it."""


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return -k_s (x - a) - d_s v beyond a, else 0 [N*m].

    It is the torque of the two-sided stop for a deck that stays on the side of a.
    """
    angle = parameters["angle"]
    side = m.where(angle > 0, 1.0, -1.0)
    here = replace(motion, tilt=side * m.maximum(side * motion.tilt, 0.0))
    return end_stop.torque(m, here, {**parameters, "angle": m.maximum(side * angle, NEAREST)}, states)


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Write a spring tendon that is slack up to the stop; MuJoCo has no damper that acts on one side only."""
    angle = parameters["angle"]
    slack = (-UNREACHABLE_TILT, angle) if angle > 0 else (angle, UNREACHABLE_TILT)
    return end_stop.write_stop(spec, joint, "one-sided-stop", parameters, slack, f"{angle:+.6g}")


def other_side(parameters: Numbers) -> list[dict[str, float]]:
    """Return the stop on the other side. A descent cannot reach it: at a = 0 the deck never leaves the stop."""
    return [{**parameters, "angle": -parameters["angle"]}]


_ANGLE, _STIFFNESS, _DAMPING = end_stop.EFFECT.parameters

EFFECT = TorqueEffect(
    name="one-sided-stop",
    title="end stop on one side",
    family="stop",
    parameters=(
        Parameter(
            "angle", "rad", _ANGLE.size, low=-1.0, high=1.0, starts=(-0.8, -0.5, 0.5, 0.8), neutral=1.0
        ),
        _STIFFNESS,
        _DAMPING,
    ),
    law="τ = -k_s (x - a) - d_s v beyond a; a > 0 is met at positive angles",
    source=end_stop.EFFECT.source,
    does="Wide swings turn round early on one side; below the angle of the stop nothing changes.",
    look_alikes=("end-stop", "bilinear-stiffness", "asymmetric-stiffness"),
    experiment="Release from below and above the angle of the stop, to either side: only one side turns round early.",
    mujoco=MujocoSupport(
        means="fixed tendon with a stiffness, slack up to the stop (its loss is left out)",
        leaves_out="damping",
    ),
    to_mjcf=to_mjcf,
    example=(0.08, 60.0, 0.0),
    torque=torque,
    acts_during_hold=True,
    excludes=("end-stop",),
    nonsmooth=True,
    restarts=other_side,
)
