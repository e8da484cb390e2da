"""Weight of a deck with its centre of mass off the tilt axis."""

from math import isnan

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect
from sysid.errors import SysidError


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return -M sin φ [N*m]."""
    return -parameters["moment"] * m.sin(motion.roll)


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Lower the centre of mass of the joint's body, keeping its inertia about the axis.

    Raises:
        SysidError: The shift alone makes a larger inertia about the axis than that of the body.
    """
    body = joint.parent
    gravity = float(-spec.option.gravity[2])
    if gravity <= 0:
        raise SysidError(
            "gravity is off in this model (option gravity 0 0 0); switch it on for the sine term."
        )
    drop = parameters["moment"] / (body.mass * gravity)
    about_own = body.inertia[0] - body.mass * drop**2
    if about_own <= 0:
        raise SysidError(
            f"gravity moment {parameters['moment']:.4g} N*m needs the mass {body.mass:.4g} kg {abs(drop):.3g} m "
            f"off the axis, more than the roll inertia {body.inertia[0]:.4g} kg*m^2 allows. Check the mass."
        )
    x, y, z = (0.0 if isnan(value) else float(value) for value in body.ipos)  # NaN: not set
    body.ipos = [x, y, z - drop]
    body.inertia[0] = about_own
    return (f"gravity: centre of mass {drop:.6g} m below the axis, roll inertia about the axis unchanged",)


EFFECT = TorqueEffect(
    name="gravity",
    title="centre of mass off the axis",
    family="hardening",
    also_called=("weight", "centre of mass", "center of mass"),
    parameters=(Parameter("moment", "N*m", lambda s: s.stiffness, low=-1.0, high=3.0, starts=(0.3, 0.98)),),
    law="τ = -M sin φ; M = m g h with the centre of mass h below the axis",
    formula="{moment} sin φ",
    source="physical pendulum; Huygens 1673",
    does="Adds M to the stiffness; only wide swings (beyond 30°) show the sine by a longer period.",
    look_alikes=("cubic-stiffness", "stiffness of the record"),
    experiment="Turn the board over, or tilt the floor by 2°: only weight pulls towards the vertical.",
    mujoco=MujocoSupport(means="position of the body's centre of mass"),
    to_mjcf=to_mjcf,
    example=(1.0,),
    torque=torque,
    grounded=True,
    adds_stiffness="moment",
    record_direction=(1.0, 0.0),
)
