"""Weight on a joint along its whole path, from the masses of a model: known, hence not fitted."""

import math

from sysid.effects._algebra import NUMPY, Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect
from sysid.effects._harmonics import FORMULA, HARMONICS, held, slope_of, value_of
from sysid.errors import SysidError

ASSUMED = 0.01
"""Assumed relative standard deviation of weight over inertia if a record has none: an arm of 0.1 m by a tape. Gravity on Earth
varies by 0.5 %."""


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return s times the sum of harmonics [N*m]; s is 1 where it is no parameter."""
    return parameters.get("scale", 1.0) * value_of(m, motion.roll, parameters)


def slope(parameters: Numbers, roll: float) -> float:
    """Return its stiffness for small motions about a roll [N*m/rad]."""
    return -parameters.get("scale", 1.0) * float(slope_of(NUMPY, roll, parameters))


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Move the centre of mass of a bench's body to make that weight; a model of the robot has its masses already.

    Raises:
        SysidError: The weight is not that of one rigid body on a hinge.
    """
    body, p = joint.parent, parameters
    force = body.mass * float(-spec.option.gravity[2])
    if force <= 0 or any(p[name] for name in HARMONICS if name not in ("sine", "cosine")):
        raise SysidError(
            "a bench of one body cannot pull as this weight does (a slide, a linkage, or gravity is off). Release the joint "
            "in its own model (--model, --joint)."
        )
    y, z = -p["scale"] * p["cosine"] / force, p["scale"] * p["sine"] / force
    about_own = body.inertia[0] - body.mass * (y * y + z * z)
    if about_own <= 0:
        raise SysidError(
            f"the weight needs the mass {body.mass:.4g} kg {math.hypot(y, z):.3g} m off the axis, more than the inertia "
            f"{body.inertia[0]:.4g} kg*m^2 allows. Check the mass."
        )
    body.ipos, body.inertia[0] = [0.0, y, z], about_own
    return (
        f"weight: centre of mass {math.hypot(y, z):.6g} m off the axis, inertia about the axis unchanged",
    )


EFFECT = TorqueEffect(
    name="weight",
    title="weight as the model states it",
    family="hardening",
    role="record",
    parameters=(
        Parameter("scale", "1", low=0.1, high=10.0, starts=(1.0,), neutral=1.0, held=True, assumed=ASSUMED),
        *held("N*m"),
    ),
    law=f"τ = s ({FORMULA}), all but s from the masses of a model",
    source="gravity and bias forces along the arc of the joint; s is fitted within the record's deviation where only the weight pulls back",
    does="Pulls the joint to where its weight hangs, with a torque known in N·m that gives the others a scale.",
    look_alikes=("gravity", "stiffness of the record"),
    experiment="Measure in another pose or with a known mass added: weight changes as the model says, a spring does not.",
    mujoco=MujocoSupport(means="the masses of the model"),
    to_mjcf=to_mjcf,
    example=(1.0, 0.0, -1.0, 0.15, 0.0, 0.0, 0.0, 0.0),
    torque=torque,
    grounded=True,
    identifiable_from_decay=False,
    slope=slope,
)
