"""How far to tilt the deck so that the board turns to a heading in the time that is left.

Both trucks of a lean-to-steer board turn, in opposite senses, by σ with tan σ = tan λ sin γ. The axles
meet at a radius L / (2 tan σ), hence ψ̇ = 2 v tan σ / L. The HUSKY paper writes ψ̇ = v tan σ / L, as for a
single steered axle, and so asks for twice the tilt. It can be chosen.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from sim.skate.arrays import namespace, wrap_angle

Kinematics = Literal["two-truck", "single-truck"]
"""'two-truck' is the board's own turning; 'single-truck' is the paper's formula."""


@dataclass(frozen=True, slots=True)
class TiltGuidance:
    """The board's turning geometry and the caution with which it is inverted."""

    wheelbase: float
    """Distance between the axles L [m]."""
    rake: float
    """Angle λ of tan σ = tan λ sin γ [rad]."""
    limit: float
    """Largest tilt to ask for, either side [rad]."""
    kinematics: Kinematics = "two-truck"
    damping_speed: float = 0.3
    """Speed below which less and less tilt is asked for [m/s]: a board at rest does not turn."""
    least_time: float = 0.5
    """Floor of the time left [s], so that the last steps of steering ask for no jerk."""
    longest_time: float = 1.2
    """Ceiling of the time left [s]; inf spreads the turn over the whole phase, as in the paper. An early turn
    leaves time to correct it."""
    spread: float = 2.0
    """Time over which a turn is spread evenly [s]: a policy would answer a sudden turn by a corner."""

    def time(self, left: Any) -> Any:
        """Return the time to plan for when so much is left [s], shape (...,)."""
        return namespace(left).clip(left, self.least_time, self.longest_time)

    def reference(self, heading: Any, target: Any, speed: Any, time_left: Any) -> Any:
        """Return the tilt γ_ref that reaches the target heading when the time is up [rad].

        Args:
            heading: Heading of the board [rad], shape (...,).
            target: Heading to reach [rad], shape (...,).
            speed: Forward speed of the board [m/s], shape (...,), negative where it rolls back.
            time_left: Time until steering ends [s], shape (...,); taken as at least `least_time`.

        Returns:
            Tilt, left edge down positive, within ±`limit`, shape (...,).
        """
        xp = namespace(heading)
        rate = wrap_angle(target - heading) / self.time(time_left)
        slowness = speed / (speed**2 + self.damping_speed**2)  # 1 / speed, damped
        trucks = 2 if self.kinematics == "two-truck" else 1
        sine = rate * self.wheelbase * slowness / (trucks * np.tan(self.rake))
        return xp.arcsin(xp.clip(sine, -np.sin(self.limit), np.sin(self.limit)))
