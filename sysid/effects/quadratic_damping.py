"""Drag that grows with the square of the rate."""

from sysid.effects._base import TorqueEffect
from sysid.effects._mjcf import polynomial

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
)
