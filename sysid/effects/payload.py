"""Weight of a known mass fixed to a joint, besides the model's own masses, which may be wrong."""

from collections.abc import Sequence

from sysid.effects._algebra import NUMPY, Algebra, Numbers, Value, Values
from sysid.effects._base import JointState, MujocoSupport, TorqueEffect
from sysid.effects._harmonics import FORMULA, HARMONICS, held, slope_of, value_of
from sysid.effects._mjcf import refusing


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return the sum of harmonics [N*m]."""
    return value_of(m, motion.roll, parameters)


def slope(parameters: Numbers, roll: float) -> float:
    """Return its stiffness for small motions about a roll [N*m/rad]."""
    return -float(slope_of(NUMPY, roll, parameters))


EFFECT = TorqueEffect(
    name="payload",
    title="weight of a known mass",
    family="hardening",
    role="record",
    parameters=held("N*m"),
    law=f"τ = {FORMULA}, from mass and place",
    source="mj_inverse along the arc of the joint, with the mass and without",
    does="Adds a torque and an inertia that are known, which gives those of the joint a scale.",
    look_alikes=("gravity", "weight"),
    experiment="Take it off: the change is known in kg and m.",
    mujoco=MujocoSupport(means="nothing: it was there for the measurement", since=""),
    to_mjcf=refusing(
        "a payload belongs to a measurement, not to a bench. Release the joint in its own model (--model, --joint, --payload)."
    ),
    example=(0.0,) * len(HARMONICS),
    torque=torque,
    grounded=True,
    identifiable_from_decay=False,
    slope=slope,
)
