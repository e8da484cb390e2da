"""Where in the cycle episodes begin."""

from dataclasses import dataclass

STANDING_PLACE = -0.075
"""Where the right foot stands along the deck at the paper's start at rest, from the front marker [m]; in the
canonical poses it stands on the marker."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """Where in the cycle episodes begin; shares add up to 1."""

    standing: float = 0.5
    """Share that begins the cycle at rest, one foot on the ground."""
    pushing: float = 0.25
    """Share that rolls in the push pose, anywhere in the pushing stretch."""
    steering: float = 0.25
    """Share that rolls on its way into the steer pose or in it: half of them anywhere in mounting, half in steering."""
    speed: tuple[float, float] = (0.2, 1.6)
    """Speed of those that roll [m/s]."""
    position_noise: float = 0.02
    """Half-width of the pelvis' offset beside the board [m]."""
    joint_noise: float = 0.01
    """[rad]."""

    def __post_init__(self) -> None:
        """Check the shares."""
        total = self.standing + self.pushing + self.steering
        if abs(total - 1) > 1e-6:
            raise ValueError(f"the shares of starts add up to {total}; expected 1")
