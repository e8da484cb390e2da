"""Left and right springs that differ."""

from sysid.effects._base import TorqueEffect
from sysid.effects._mjcf import polynomial

EFFECT = TorqueEffect(
    name="asymmetric-stiffness",
    title="stiffer to one side",
    family="asymmetry",
    also_called=("asymmetry",),
    law="τ = -b x²; b > 0 is stiffer at positive angles",
    formula="{coefficient} φ²",
    source="Nayfeh and Mook, Nonlinear Oscillations (1979), quadratic nonlinearity",
    does="Swings to one side are wider and longer than to the other; the middle drifts with amplitude.",
    look_alikes=("offset", "preload", "sensor-bias"),
    experiment="Release once from each side, and from {3°} and {12°}: only unequal springs treat them unequally.",
    **polynomial("asymmetric-stiffness", "stiffness", 2, low=-0.9, high=0.9, starts=(0.05, -0.05)),
    example=(25.0,),
)
