"""A body that hangs from the deck, or stands on it on a spring, and swings after it."""

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import (
    JointState,
    MjsJoint,
    MjSpec,
    MujocoSupport,
    Parameter,
    State,
    TorqueEffect,
    at_tilt,
)
from sysid.effects._mjcf import add_hinged_body


def acceleration(m: Algebra, motion: JointState, states: States, parameters: Values) -> Value:
    """Return the body's angular acceleration ω² (x - ψ) + 2 ζ ω (v - ψ̇) [rad/s^2]."""
    frequency = parameters["frequency"]
    behind, slower = motion.tilt - states[0], motion.rate - states[1]
    return frequency**2 * behind + 2 * parameters["damping_ratio"] * frequency * slower


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return the reaction of the body on the deck [N*m]."""
    return -parameters["inertia"] * acceleration(m, motion, states, parameters)


def own_rate(m: Algebra, motion: JointState, states: States, parameters: Values) -> Value:
    """Return ψ̇ [rad/s]."""
    return states[1]


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Add the body to the deck, on a hinge of the same axis with its spring and damper."""
    inertia, frequency = parameters["inertia"], parameters["frequency"]
    add_hinged_body(
        joint.parent, joint, "hanging", joint.pos, inertia=inertia, stiffness=inertia * frequency**2,
        damping=2 * parameters["damping_ratio"] * frequency * inertia,
    )  # fmt: skip
    return (
        f"hanging-body: {inertia:.6g} kg*m^2 on the joint at {frequency:.6g} rad/s, damping ratio "
        f"{parameters['damping_ratio']:.6g}, on a hinge of its own",
    )


EFFECT = TorqueEffect(
    name="hanging-body",
    title="hanging body",
    family="relaxation",
    parameters=(
        Parameter("inertia", "kg*m^2", low=0.0, high=5.0, starts=(0.05, 0.3)),
        Parameter(
            "frequency",
            "rad/s",
            lambda s: s.frequency,
            low=0.2,
            high=5.0,
            starts=(0.6, 1.0, 1.8),
            neutral=None,
        ),
        Parameter("damping_ratio", "1", low=0.0, high=1.0, starts=(0.05,), neutral=None, default=0.0),
    ),
    law="τ = -J ψ̈, ψ̈ = ω² (x - ψ) + 2 ζ ω (v - ψ̇)",
    source="tuned mass damper, den Hartog, Mechanical Vibrations (1934); a mass m hung a beside the axis has J = m a²",
    does="The swing is passed to the body and comes back: the amplitude beats instead of falling steadily.",
    look_alikes=("second-mode", "viscoelastic"),
    experiment="Take off or hold what hangs on the joint and release again: the beat disappears.",
    mujoco=MujocoSupport(means="a body on the joint with a hinge, a spring and a damper"),
    to_mjcf=to_mjcf,
    example=(0.001, 30.0, 0.03),
    torque=torque,
    stepped=("frequency", "damping_ratio"),
    states=(
        State(name="roll", start=at_tilt, size=lambda s: s.amplitude, most=4.0, rate=own_rate),
        State(name="rate", size=lambda s: s.rate, most=4.0, rate=acceleration),
    ),
)
