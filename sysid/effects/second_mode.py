"""A compliant support of the joint: wheels, hanger, carpet."""

from sysid.effects._algebra import Algebra, Numbers, Value, Values
from sysid.effects._base import MjsJoint, MjSpec, MujocoSupport, Parameter, State, SupportEffect
from sysid.effects._mjcf import add_hinged_body, rest_of


def support_at_release(m: Algebra, tilt: Value, hold: Value, stiffness: Value, parameters: Values) -> Value:
    """Return the roll of the support while the deck is held still [rad]: both springs have the same torque."""
    return tilt * stiffness / (stiffness + parameters["stiffness"])


def acceleration(m: Algebra, angle: Value, rate: Value, torque: Value, parameters: Values) -> Value:
    """Return (-k_s s - d_s ṡ - τ)/J [rad/s^2]."""
    own = -parameters["stiffness"] * angle - parameters["damping"] * rate
    return (own - torque) / parameters["inertia"]


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Add the support as a body of its own, tied to the deck by a tendon of their difference.

    The joint's own spring, damper and friction move to that tendon, so write this effect last.
    """
    hinge = add_hinged_body(joint.parent.parent, joint, "support", joint.parent.pos, **parameters)
    rest = rest_of(spec, joint)
    tendon = spec.add_tendon(name=f"{joint.name}_on_support")
    tendon.wrap_joint(joint.name, 1.0)
    tendon.wrap_joint(hinge.name, -1.0)
    tendon.springlength = [rest, rest]
    for index in range(3):
        tendon.stiffness[index], joint.stiffness[index] = joint.stiffness[index], 0.0
        tendon.damping[index], joint.damping[index] = joint.damping[index], 0.0
    tendon.frictionloss, joint.frictionloss = joint.frictionloss, 0.0
    tendon.solref_friction, tendon.solimp_friction = joint.solref_friction, joint.solimp_friction
    return (
        f"second-mode: support {parameters['inertia']:.6g} kg*m^2 on {parameters['stiffness']:.6g} N*m/rad and "
        f"{parameters['damping']:.6g} N*m*s/rad; the tilt spring is a tendon between deck and support",
    )


EFFECT = SupportEffect(
    name="second-mode",
    title="compliant support",
    family="relaxation",
    also_called=("compliance", "flexibility", "resonance"),
    parameters=(
        Parameter("inertia", "kg*m^2", low=0.003, high=20.0, starts=(0.1, 1.0), neutral=None),
        Parameter("stiffness", "N*m/rad", low=0.3, high=60.0, starts=(4.0,), neutral=None),
        Parameter("damping", "N*m*s/rad", low=0.0, high=10.0, starts=(0.03, 0.3), default=0.0),
    ),
    law="J s̈ = -k_s s - d_s ṡ + k x + d v - Σ τ, with x = φ - s - rest angle",
    source="two-degree-of-freedom oscillator, den Hartog, Mechanical Vibrations (1934)",
    does="A second frequency rides on the decay, or, if it is damped, the decay looks viscoelastic.",
    look_alikes=("viscoelastic", "hanging-body"),
    experiment="Block the trucks or stand the board on concrete: a compliant support then disappears.",
    mujoco=MujocoSupport(means="a second hinge and a tendon of the difference"),
    to_mjcf=to_mjcf,
    example=(0.004, 60.0, 0.1),
    states=(
        State(
            name="support",
            start=support_at_release,
            size=lambda s: 0.2 * s.amplitude,
            most=4.0,
        ),
        State(name="support_rate", size=lambda s: 0.2 * s.rate, most=4.0),
    ),
    acceleration=acceleration,
    series_stiffness="stiffness",
    stepped=("inertia", "damping"),
)
