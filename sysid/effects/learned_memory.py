"""A learned torque of one internal state: a memory of the path, without a formula.

The motion stretches an arm, which relaxes with time and with the path: `τ = q(z)`, `ż = (v - |v| z) / a - z / T`. Here q is a smooth
table with q(0) = 0. Creeping rubber relaxes with time alone (a → ∞), a slider with round corners with the path alone (T → ∞).
"""

from collections.abc import Sequence
from functools import cache

from sysid.effects._algebra import Algebra, Numbers, Value, Values
from sysid.effects._base import (
    JointState,
    MjsJoint,
    MjSpec,
    MujocoSupport,
    Parameter,
    Smoothness,
    State,
    TorqueEffect,
)
from sysid.effects._table import bending, interpolate, knots, position, table_value

KNOTS, GRADING = 4, 0.5
STRETCH = tuple(f"stretch_{j}" for j in range(-KNOTS, KNOTS + 1) if j != 0)


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return q(z) [N*m]."""
    z = m.maximum(-1.0, m.minimum(1.0, states[0]))
    return interpolate(m, position(m, z, GRADING), [parameters[name] for name in STRETCH])


def stretching(m: Algebra, motion: JointState, states: Sequence[Value], parameters: Values) -> Value:
    """Return (v - |v| z) / a - z / T [1/s]."""
    (z,) = states
    return (motion.rate - m.abs(motion.rate) * z) / parameters["reach"] - parameters["fading"] * z


def held(m: Algebra, tilt: Value, hold: Value, stiffness: Value, parameters: Values) -> Value:
    """Return the stretch after a slow drag from rest to the release angle and a hold."""
    dragged = m.where(tilt > 0, 1.0, -1.0) * (1 - m.exp(-m.abs(tilt) / parameters["reach"]))
    return dragged * m.exp(-parameters["fading"] * hold)


@cache
def smoothness() -> Smoothness:
    """Return the roughness of the table; it has no part of spring or damper."""
    return Smoothness(names=STRETCH, tables=("stretch",), forms=(bending(KNOTS),), linear={})


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Write only a comment: MuJoCo has no such arm."""
    return ("learned-memory: left out, MuJoCo has no joint that remembers",)


EFFECT = TorqueEffect(
    name="learned-memory",
    title="a learned torque that remembers the path",
    family="learned",
    role="learned",
    parameters=(
        Parameter(
            "reach", "rad", lambda s: s.amplitude, low=0.01, high=10.0, starts=(0.1, 0.4, 10.0), neutral=None
        ),
        Parameter(
            "fading", "1/s", lambda s: s.frequency, low=0.0, high=20.0, starts=(0.0, 0.1, 0.5, 2.0),
            neutral=None,
        ),
        *map(table_value, STRETCH),
    ),
    law="τ = q(z), ż = (v - |v| z) / a - z / T: a smooth table of a remembered stretch",
    source="between Maxwell 1867 (a → ∞) and Bouc 1967 (T → ∞)",
    does="The torque depends on where the joint came from: creep, slip, a second body.",
    look_alikes=("viscoelastic", "hysteresis", "bouc-wen", "second-mode"),
    experiment="Hold for 0.2 s and for 5 s before the release, and release from small and wide angles.",
    mujoco=MujocoSupport(
        means="nothing that remembers so", since="", substitute="the joint without it"
    ),
    to_mjcf=to_mjcf,
    example=(0.02, 0.0, *(-0.16 * knots(KNOTS, GRADING)).tolist()),
    torque=torque,
    states=(State(name="stretch", start=held, size=lambda s: 0.3, rate=stretching),),
    sharpness=2.0,
    smoothness=smoothness,
)  # fmt: skip
