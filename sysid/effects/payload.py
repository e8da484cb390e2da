"""Weight of a known mass fixed to a joint, besides the model's own masses, which may be wrong."""

from sysid.effects import weight
from sysid.effects._base import MujocoSupport, TorqueEffect
from sysid.effects._harmonics import FORMULA, HARMONICS, held
from sysid.effects._mjcf import refusing

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
    mujoco=MujocoSupport(means="nothing: it was there for the measurement"),
    to_mjcf=refusing(
        "a payload belongs to a measurement, not to a bench. Release the joint in its own model (--model, --joint, --payload)."
    ),
    example=(0.0,) * len(HARMONICS),
    torque=weight.torque,
    grounded=True,
    identifiable_from_decay=False,
    slope=weight.slope,
)
