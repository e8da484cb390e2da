"""Drag that grows with the square of the rate."""

from collections.abc import Sequence

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, TorqueEffect
from sysid.effects._mjcf import polynomial


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return -c v|v| [N*m]."""
    return -parameters["coefficient"] * motion.rate * m.abs(motion.rate)


EFFECT = TorqueEffect(
    name="quadratic-damping",
    title="quadratic damping",
    family="drag",
    also_called=("drag", "air drag", "aerodynamic drag"),
    law="τ = -c v|v|",
    formula="{coefficient} φ̇|φ̇|",
    source="Froude 1874; ITTC 7.5-02-07-04.5, roll decay: p₁ + p₂|v|",
    does="The damping ratio falls in proportion to amplitude: fast decay at first, slow later.",
    look_alikes=("cubic-damping",),
    experiment="Release from {3°}, {7°} and {12°}: damping rises with amplitude for v|v|, with its square for v³.",
    **polynomial("quadratic-damping", "damping", 2, low=0.0, high=5.0, starts=(0.05, 0.5)),
    example=(0.06,),
    torque=torque,
)
