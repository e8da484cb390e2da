"""Damping that grows with the cube of the rate."""

from sysid.effects._base import TorqueEffect
from sysid.effects._mjcf import polynomial

EFFECT = TorqueEffect(
    name="cubic-damping",
    title="cubic damping",
    family="drag",
    also_called=("nonlinear damping",),
    law="τ = -c v³",
    formula="{coefficient} φ̇³",
    source="Dalzell, J. Ship Research 22 (1978): cubic in place of quadratic roll damping",
    does="The damping ratio falls with the square of the amplitude; small swings are damped linearly.",
    look_alikes=("quadratic-damping",),
    experiment="Release from {3°}, {7°} and {12°}: damping rises with amplitude for v|v|, with its square for v³.",
    **polynomial("cubic-damping", "damping", 3, low=0.0, high=10.0, starts=(0.05, 0.5)),
    example=(0.02,),
)
