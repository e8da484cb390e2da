"""Play of a joint about its rest."""

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect
from sysid.effects._mjcf import add_tendon, rest_of


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return +k x within the gap and ±k w beyond it [N*m], which cancels the linear spring there."""
    gap = parameters["half_width"]
    return motion.stiffness * m.maximum(-gap, m.minimum(gap, motion.tilt))


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Replace the joint's linear spring by a tendon with a dead band."""
    rest = rest_of(spec, joint)
    gap = parameters["half_width"]
    add_tendon(spec, joint, "freeplay", joint.stiffness[0], (rest - gap, rest + gap))
    joint.stiffness[0] = 0.0
    return (f"freeplay: the linear spring is a tendon that is slack within ±{gap:.6g} rad",)


EFFECT = TorqueEffect(
    name="freeplay",
    title="freeplay, a dead band",
    family="freeplay",
    also_called=("backlash", "dead band", "deadband", "play", "slop"),
    parameters=(Parameter("half_width", "rad", low=0.0, high=0.8, starts=(0.02, 0.08, 0.2)),),
    law="τ = -k (x - clip(x, ±w)): the linear spring acts beyond ±w only",
    source="Nordin and Gutman, Automatica 38 (2002): backlash",
    does="Small swings are slow and the joint may rest anywhere in the gap; wide ones are nearly normal.",
    look_alikes=("cubic-stiffness", "coulomb"),
    experiment="Release from {1°} and from {10°}, and push the joint by hand: it moves freely within the gap.",
    mujoco=MujocoSupport(means="fixed tendon with a dead band (springlength)"),
    to_mjcf=to_mjcf,
    example=(0.02,),
    torque=torque,
    nonsmooth=True,
)
