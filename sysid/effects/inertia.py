"""A roll inertia other than that of the record."""

from dataclasses import replace

from sysid.effects._algebra import Numbers, Values
from sysid.effects._base import LinearJoint, MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect


def scaled(joint: LinearJoint, parameters: Values) -> LinearJoint:
    """Return the joint with r times its inertia."""
    return replace(joint, inertia=joint.inertia * parameters["ratio"])


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Scale the roll inertia of the joint's body."""
    body = joint.parent
    body.inertia[0] *= parameters["ratio"]
    return (f"inertia: roll inertia times {parameters['ratio']:.6g}",)


EFFECT = TorqueEffect(
    name="inertia",
    title="the record's roll inertia is wrong",
    family="inertia",
    role="record",
    parameters=(Parameter("ratio", "1", low=0.1, high=10.0, starts=(1.0,), neutral=1.0),),
    law="I → r I",
    source="only k/I, d/I and τ/I show in a free decay",
    does="Period and damping both change as if stiffness and damping were divided by the same number.",
    look_alikes=("clock", "stiffness and damping of the record"),
    experiment="Add 1 kg at a known distance and repeat: two decays give the inertia itself.",
    mujoco=MujocoSupport(means="diagonal inertia of the body"),
    to_mjcf=to_mjcf,
    example=(1.3,),
    modifies=scaled,
    identifiable_from_decay=False,
    record_direction=(1.0, 1.0),
)
