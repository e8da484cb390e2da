"""Options of the task."""

import math
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Self

from sim.board.scene import Coupling
from sim.skate.cycle.clock import Clock
from sim.skate.cycle.start import AT_REST, STANDING_PLACE, Start
from sim.skate.cycle.tilt_guidance import Kinematics
from sim.skate.world.terrain import Terrain

Pushing = Literal["amp", "tracking", "gait"]
"""Teacher of pushing: the style of reference motions, joint angles of the clip nearest in speed, or a clock of foot contacts."""
STYLE_FRAMES = 5
"""Joint frames that the style discriminator judges together."""
Guidance = Literal["path", "translation", "style", "none"]
"""Guidance of mounting and dismounting: positions and orientations of the key bodies, positions only, the style
of reference motions, or nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SkateOptions:
    """One variant of the task."""

    pushing: Pushing = "amp"
    transition: Guidance = "path"
    stance_patience: int = 20
    """Policy steps with the left foot off the deck while steering, or on it while pushing, after which an
    episode ends; 0 for never."""
    tilt_guidance: bool = True
    kinematics: Kinematics = "two-truck"
    foot_place: tuple[float, float] = (-0.12, 0.0)
    """Place of the right foot along the deck, from the front marker [m], drawn at the start and kept."""
    speed_tolerance: float = 0.25
    """Tolerance of the reward for the board's speed while pushing [m^2/s^2]."""
    stance: float = 40.0
    """Weight of a pushing foot that stands on the ground without slipping while the board passes it."""
    slip: float = 60.0
    """Cost of a slip of 1 m/s under the robot's whole weight, a second."""
    touchdown: float = 50.0
    """Cost of a touchdown of the pushing foot, in policy steps: strides shall be few and long."""
    landing: float = 60.0
    """Cost of a touchdown of the pushing foot at 1 m/s over the ground, in policy steps."""
    beginner: float = 0.25
    """Share of the costs of slip, touchdown and landing that a beginner pays."""
    coupling: Coupling = "equality"
    steered: bool = True
    """Whether tilting steers at all; without it the board goes straight."""
    terrain: Terrain = "flat"
    turn_feedback: bool = True
    """Whether the actor sees the turn that is left, by its own yaw; else the turn as it was told, as in the
    paper."""
    idle_patience: float = 1.2
    """Time in pushing without the left foot on the ground after which an episode ends [s]; 0 for never."""
    change: float = 5.0
    """Mean time between two changes of the commanded speed [s]; inf keeps one for a whole episode."""
    speed: tuple[float, float] = (0.0, 1.5)
    """Range of the commanded speed [m/s]."""
    standing: float = 0.2
    """Share of the commands that tell the robot to stand, besides the range's and the slow ones' own."""
    slow: float = 0.3
    """Share of the commands up to 0.4 m/s, besides the range's own: slow rides fall on slopes."""
    turn: float = math.pi / 4
    """Largest commanded change of heading to either side [rad]."""
    start: Start = field(default_factory=Start)
    boards: int = 64
    """Number of boards drawn from the posterior; 0 trains on the record itself."""
    pushes: float = 0.5
    """Largest change of velocity by external pushes [m/s]; 0 for none."""
    mount_steps: int = 30
    """Length of mounting in policy steps."""
    bezier_order: int = 2
    pose_offset: float = 0.0
    """Perturbation of the canonical poses: this much is added to every joint [rad]."""
    noise: bool = True
    """Noise on the actor's observation."""
    strength: float = 1.0
    """Share of the full variation by which worlds differ, 0 to 1; the curriculum leads it. 0 leaves every world nominal."""
    episode: float = 60.0
    """Length of an episode [s]: what adds up from cycle to cycle shows in the tenth, not in the third."""

    @classmethod
    def nominal(cls, **changes: Any) -> Self:
        """Return the task as it is measured: one world, no noise, no shoves, from rest where the paper starts."""
        plain: dict[str, Any] = {
            "start": replace(AT_REST, position_noise=0.0),
            "foot_place": (STANDING_PLACE, STANDING_PLACE),
            "boards": 0,
            "pushes": 0.0,
            "standing": 0.0,
            "slow": 0.0,
            "change": math.inf,
            "noise": False,
            "strength": 0.0,
            "stance_patience": 0,
            "idle_patience": 0.0,
            "episode": 20.0,
        }
        return cls(**(plain | changes))

    @property
    def clock(self) -> Clock:
        """The cycle in time."""
        return Clock(mount=self.mount_steps)

    @property
    def styled(self) -> bool:
        """Whether anything is taught by the style of reference motions."""
        return self.pushing == "amp" or self.transition == "style"
