"""Inertia of a motor's rotor and gear, beyond the model's."""

from dataclasses import replace

from sysid.effects._algebra import Numbers, Values
from sysid.effects._base import LinearJoint, MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect


def added(joint: LinearJoint, parameters: Values) -> LinearJoint:
    """Return the joint with A more inertia."""
    return replace(joint, inertia=joint.inertia + parameters["inertia"])


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Add to the joint's armature."""
    joint.armature += parameters["inertia"]
    return (f"armature: {parameters['inertia']:+.6g} kg*m^2",)


EFFECT = TorqueEffect(
    name="armature",
    title="inertia of rotor and gear",
    family="inertia",
    also_called=("rotor inertia", "reflected inertia"),
    role="record",
    parameters=(Parameter("inertia", "kg*m^2", low=-0.95, high=20.0, starts=(0.3,)),),
    law="I → I + A; A = N² J of a rotor of inertia J behind a gear of ratio N",
    formula="{inertia} φ̈",
    source="only k/I, d/I and τ/I show in a free decay; a known weight gives them a scale",
    does="The joint swings slower and loses less for each swing, as if all its torques were smaller.",
    look_alikes=("inertia", "clock", "weight"),
    experiment="Swing a known weight, or the same joint with a known mass added: both give the inertia itself.",
    mujoco=MujocoSupport(means="armature of the joint"),
    to_mjcf=to_mjcf,
    example=(0.003,),
    modifies=added,
    identifiable_from_decay=False,
    identifiable_with=("weight",),
    adds_inertia="inertia",
)
