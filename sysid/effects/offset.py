"""A rest angle that is not where the record says."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from sysid.effects._algebra import Values
from sysid.effects._base import LinearJoint, MujocoSupport, Parameter, TorqueEffect, spec_angle

if TYPE_CHECKING:
    import mujoco


def moved(joint: LinearJoint, parameters: Values) -> LinearJoint:
    """Return the joint with its rest angle moved by δ."""
    return replace(joint, rest_angle=joint.rest_angle + parameters["angle"])


def to_mjcf(
    spec: "mujoco.MjSpec", joint: "mujoco.MjsJoint", parameters: Mapping[str, float], *, exact: bool = True
) -> tuple[str, ...]:
    """Move the spring's reference."""
    del exact
    joint.springref += spec_angle(spec, parameters["angle"])
    return (f"offset: springref moved by {parameters['angle']:.6g} rad",)


EFFECT = TorqueEffect(
    name="offset",
    title="rest angle moved",
    role="shift",
    parameters=(
        Parameter(name="angle", unit="rad", size=lambda s: s.amplitude, low=-1.0, high=1.0, starts=(0.01,)),
    ),
    law="x = φ - rest angle - δ",
    source="definition of the tilt",
    does="The whole decay moves up or down by a constant; its shape stays.",
    look_alikes=("preload", "sensor-bias"),
    experiment="Turn the sensor round on the deck and repeat: a sensor bias changes sign, a real offset not.",
    mujoco=MujocoSupport(means="joint springref", since="3.0", warp=True),
    to_mjcf=to_mjcf,
    example=(0.02,),
    modifies=moved,
    same_as=("rest_angle", "preload", "sensor-bias"),
)
