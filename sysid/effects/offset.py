"""A rest angle other than that of the record."""

from dataclasses import replace

from sysid.effects._algebra import Numbers, Values
from sysid.effects._base import LinearJoint, MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect
from sysid.effects._mjcf import spec_angle


def moved(joint: LinearJoint, parameters: Values) -> LinearJoint:
    """Return the joint with its rest angle moved by δ."""
    return replace(joint, rest_angle=joint.rest_angle + parameters["angle"])


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Move the spring's reference."""
    joint.springref += spec_angle(spec, parameters["angle"])
    return (f"offset: springref moved by {parameters['angle']:.6g} rad",)


EFFECT = TorqueEffect(
    name="offset",
    title="rest angle moved",
    family="rest",
    also_called=("zero", "rest angle"),
    role="shift",
    parameters=(Parameter("angle", "rad", low=-100.0, high=100.0, starts=(0.01,)),),
    law="x = φ - rest angle - δ",
    source="definition of the tilt",
    does="The whole decay moves up or down by a constant; its shape stays.",
    look_alikes=("preload", "sensor-bias"),
    experiment="Turn the sensor round on the joint and repeat: a sensor bias changes sign, a real offset not.",
    mujoco=MujocoSupport(means="joint springref"),
    to_mjcf=to_mjcf,
    example=(0.02,),
    modifies=moved,
    same_as=("rest_angle", "preload", "sensor-bias"),
)
