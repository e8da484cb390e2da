"""A joint that is loose about its middle."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, MujocoSupport, Parameter, TorqueEffect, rest_of

if TYPE_CHECKING:
    import mujoco


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return +k x within the gap and ±k w beyond it: what the linear spring has too much [N*m]."""
    del states
    gap = parameters["half_width"]
    return motion.stiffness * m.maximum(-gap, m.minimum(gap, motion.tilt))


def to_mjcf(
    spec: "mujoco.MjSpec", joint: "mujoco.MjsJoint", parameters: Mapping[str, float], *, exact: bool = True
) -> tuple[str, ...]:
    """Replace the joint's linear spring by a tendon with a dead band."""
    del exact
    rest = rest_of(spec, joint)
    gap = parameters["half_width"]
    tendon = spec.add_tendon(name=f"{joint.name}_freeplay")
    tendon.wrap_joint(joint.name, 1.0)
    tendon.stiffness[0] = joint.stiffness[0]
    tendon.springlength = [rest - gap, rest + gap]
    joint.stiffness[0] = 0.0
    return (f"freeplay: the linear spring is a tendon that is slack within ±{gap:.6g} rad",)


EFFECT = TorqueEffect(
    name="freeplay",
    title="freeplay, a dead band",
    parameters=(
        Parameter(
            name="half_width",
            unit="rad",
            size=lambda s: s.amplitude,
            low=0.0,
            high=0.8,
            starts=(0.02, 0.08, 0.2),
        ),
    ),
    law="τ = -k (x - clip(x, ±w)): the linear spring acts beyond ±w only",
    source="Nordin and Gutman, Automatica 38 (2002): backlash",
    does="Small swings are slow and the deck may rest anywhere in the gap; wide ones are nearly normal.",
    look_alikes=("cubic-stiffness", "coulomb"),
    experiment="Release from 1° and from 10°, and push the deck by hand: it moves freely within the gap.",
    mujoco=MujocoSupport(means="fixed tendon with a dead band (springlength)", since="3.0", warp=True),
    to_mjcf=to_mjcf,
    example=(0.02,),
    torque=torque,
    nonsmooth=True,
    decay_signs=(("shorter period", 2),),
    sharpness=4.0,
)
