"""Conditions of the episodes of an evaluation."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from sysid.errors import SysidError


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """Conditions of the episodes of an evaluation; the easy ones by default.

    Delay, noise, mass, friction, rolling, slope, push, jump, stop and a held heading are of plain MuJoCo only.
    """

    duration: float = 20.0
    """Length of an episode [s]."""
    delay: float = 0.0
    """Delay from the policy's answer to the servos [s]."""
    noise: float = 0.0
    """Noise of the sensors, over that of the training."""
    mass: float = 1.0
    """Factor of the robot's masses and inertias."""
    friction: float | None = None
    """Sliding friction of the soles on ground and deck; the scene's 1.0 if not given."""
    rolling: float = 1.0
    """Factor of the wheels' rolling friction."""
    slope: float = 0.0
    """Gradient of the ground along the start's direction [rad], uphill positive."""
    push: float = 0.0
    """Force on the pelvis for 0.1 s, in a drawn direction, every 5 to 10 s [N]."""
    terrain: Literal["flat", "slopes", "steps"] = "flat"
    """The ground: level, descents of 5 to 10 degrees, or ledges of 3 to 6 cm to roll down."""
    coupling: Literal["equality", "direct", "none"] = "equality"
    """Steering of the trucks by the deck's tilt: a constraint, set after every step, or none."""
    board_scale: Mapping[str, float] = field(default_factory=dict[str, float])
    """Factors of the board's numbers, see `sim.board.scaled`."""
    speed: tuple[float, float] = (0.0, 1.5)
    """Range of the commanded speed [m/s]."""
    turn: float = math.pi / 4
    """Largest commanded turn to either side [rad]."""
    jump: float = 0.0
    """Time after which speed and turn are drawn anew [s]; 0 for one speed an episode and one turn a cycle."""
    stop: bool = False
    """Command a stop of 9 s on the way, between 6 and 12 s."""
    hold_heading: bool = False
    """Correct the heading errors of earlier turns."""
    randomised: bool = False
    """Draw every world as in training: friction, centres of mass, boards (mjlab only)."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name, fine, wanted in (
            ("duration", self.duration > 0, "must be larger than 0"),
            ("delay", 0 <= self.delay <= 1, "from 0 to 1 s, in seconds; 20 ms is 0.02"),
            ("mass", self.mass > 0, "a factor, must be larger than 0"),
            ("rolling", self.rolling > 0, "a factor, must be larger than 0"),
            ("noise", self.noise >= 0, "must not be negative"),
            ("push", self.push >= 0, "must not be negative"),
            ("jump", self.jump >= 0, "must not be negative"),
            ("friction", self.friction is None or self.friction > 0, "must be larger than 0"),
            ("slope", abs(self.slope) < math.radians(30), "must be within ±30 degrees"),
        ):
            if not fine:
                value = math.degrees(self.slope) if name == "slope" else getattr(self, name)
                raise SysidError(f"--{name} {value:g}: {wanted}.")

    @property
    def is_stressed(self) -> bool:
        """Whether servos, sensors, masses, frictions or forces differ from the nominal ones."""
        numbers = (self.delay, self.noise, self.mass, self.friction, self.rolling, self.slope, self.push)
        return numbers != (0.0, 0.0, 1.0, None, 1.0, 0.0, 0.0)
