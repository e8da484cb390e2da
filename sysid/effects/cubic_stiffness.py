"""A spring that hardens or softens with tilt."""

from sysid.effects._base import TorqueEffect
from sysid.effects._mjcf import polynomial

EFFECT = TorqueEffect(
    name="cubic-stiffness",
    title="hardening or softening spring",
    family="hardening",
    also_called=("rubber", "hardening", "softening", "duffing"),
    law="τ = -c x³; c > 0 hardens, c < 0 softens",
    formula="{coefficient} φ³",
    source="Duffing 1918; Nayfeh and Mook, Nonlinear Oscillations (1979): ω = ω₀(1 + 3c a²/8k)",
    does="The period changes with amplitude: shorter when wide for hardening, longer for softening.",
    look_alikes=("gravity", "end-stop", "freeplay"),
    experiment="Release from {3°}, {7°} and {12°}: a cubic changes the period with the square of the amplitude.",
    **polynomial("cubic-stiffness", "stiffness", 3, low=-0.95, high=20.0, starts=(0.05, -0.2, 0.5)),
    example=(200.0,),
)
