"""A spring that is stiffer on one side."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, MujocoSupport, Parameter, TorqueEffect, rest_of

if TYPE_CHECKING:
    import mujoco

_FAR = 10.0
"""Tilt that no joint reaches [rad]: a tendon that is slack up to there never pulls on that side."""


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return -b |x| [N*m]: the stiffness is k + b with the right edge down, k - b with the left."""
    del states
    return -parameters["difference"] * m.abs(motion.tilt)


def to_mjcf(
    spec: "mujoco.MjSpec", joint: "mujoco.MjsJoint", parameters: Mapping[str, float], *, exact: bool = True
) -> tuple[str, ...]:
    """Leave the softer spring in the joint and write the rest as a tendon that pulls on the stiffer side only."""
    del exact
    difference, rest = parameters["difference"], rest_of(spec, joint)
    joint.stiffness[0] -= abs(difference)
    tendon = spec.add_tendon(name=f"{joint.name}_bilinear")
    tendon.wrap_joint(joint.name, 1.0)
    tendon.stiffness[0] = 2 * abs(difference)
    tendon.springlength = [rest - _FAR, rest] if difference > 0 else [rest, rest + _FAR]
    side = "right" if difference > 0 else "left"
    return (
        f"bilinear-stiffness: {2 * abs(difference):.6g} N*m/rad more with the {side} edge down, as a tendon",
    )


EFFECT = TorqueEffect(
    name="bilinear-stiffness",
    title="one side stiffer than the other",
    family="asymmetry",
    parameters=(
        Parameter(
            name="difference",
            unit="N*m/rad",
            size=lambda s: s.stiffness,
            low=-0.95,
            high=0.95,
            starts=(0.1, -0.1),
        ),
    ),
    law="τ = -b |x|; the stiffness is k + b with the right edge down and k - b with the left",
    formula="{difference} |φ|",
    source="piecewise linear oscillator, Shaw and Holmes, J. Sound and Vibration 90 (1983)",
    does="Half swings to one side are wider and longer than to the other by the same share at every amplitude.",
    look_alikes=("asymmetric-stiffness", "one-sided-stop", "offset", "preload", "sensor-bias"),
    experiment=(
        "Release from 3° and 12° to either side: half swings that differ by the same share at both angles are two "
        "springs, by more at 12° one spring that bends."
    ),
    mujoco=MujocoSupport(
        means="softer spring in the joint, the rest as a tendon slack on one side", since="3.0", warp=True
    ),
    to_mjcf=to_mjcf,
    example=(3.0,),
    torque=torque,
    sharpness=2.0,
)
