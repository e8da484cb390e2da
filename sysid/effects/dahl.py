"""Dry friction with presliding.

A free decay can identify the two parameters of this bristle model, torque and reach. The other three of LuGre show only at
small rates, which a swing passes within a few samples.
"""

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, State, TorqueEffect
from sysid.effects._mjcf import add_passive_motor
from sysid.effects.stribeck import bristle_stiffness


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return -F z [N*m]; z between -1 and 1 is the current share of the sliding torque."""
    return -parameters["torque"] * states[0]


def dragged(m: Algebra, share: Value, moved: Value, parameters: Values) -> Value:
    """Return the share after a move, at any speed: dz/dx = (1 ∓ z) / a, e closer to ±1 in each reach."""
    side = m.where(moved > 0, 1.0, -1.0)
    return side + (share - side) * m.exp(-m.abs(moved) / parameters["reach"])


def held(m: Algebra, tilt: Value, hold: Value, stiffness: Value, parameters: Values) -> Value:
    """Return the share after a slow drag from rest to the release angle."""
    return dragged(m, 0.0, tilt, parameters)


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Write a LuGre element of equal friction at all speeds."""
    return write_bristles(spec, joint, "dahl", parameters["torque"], parameters["reach"], native=native)


def write_bristles(
    spec: MjSpec, joint: MjsJoint, name: str, torque: float, reach: float, *, native: bool
) -> tuple[str, ...]:
    """Write a LuGre element of one torque [N*m] at all speeds, with a reach [rad] of its bristles."""
    if torque <= 0:
        return ()
    wanted = torque / reach
    stiffness = min(wanted, bristle_stiffness(spec, joint))
    # Static and sliding friction are equal, so any Stribeck speed does.
    add_passive_motor(spec, joint, name, native=native, lugre=[stiffness, 0.0, torque, torque, reach])
    softer = f", softer than its {wanted:.6g}, the limit at this time step" if stiffness < wanted else ""
    return (f"{name}: LuGre element {torque:.6g} N*m on bristles of {stiffness:.6g} N*m/rad{softer}",)


EFFECT = TorqueEffect(
    name="dahl",
    title="dry friction that gives way first (Dahl)",
    family="friction",
    also_called=("presliding",),
    parameters=(
        Parameter("torque", "N*m", low=0.0, high=1.0, starts=(0.01, 0.06)),
        Parameter("reach", "rad", low=0.002, high=0.2, starts=(0.03,), neutral=None),
    ),
    law="τ = -F z, ż = (v - |v| z) / a",
    source="Dahl, A Solid Friction Model (1968), with exponent 1",
    does="Amplitude falls as with dry friction, but the joint ends in small swings on the friction's own spring.",
    look_alikes=("coulomb", "bouc-wen", "hysteresis"),
    experiment="Release from {0.5°} and {1°}: dry friction stops there at once, friction that gives way swings on.",
    mujoco=MujocoSupport(means="dcmotor without power, with LuGre friction that is the same at all speeds"),
    to_mjcf=to_mjcf,
    example=(0.15, 0.01),
    torque=torque,
    states=(State(name="share", start=held, size=lambda s: 0.3, most=1 / 0.3, return_map=dragged),),
    excludes=("coulomb", "stribeck"),
)
