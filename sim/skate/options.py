"""What can be chosen about the task; docs/training.md says what the shipped policies were trained with, stage by stage."""

import math
from dataclasses import dataclass, field
from typing import Literal

from sim.board.scene import Coupling
from sim.skate.cycle.start import Start
from sim.skate.cycle.tilt_guidance import Kinematics
from sim.skate.world.posterior import Spread
from sim.skate.world.terrain import Terrain

Pushing = Literal["amp", "tracking", "gait", "none"]
"""How pushing is taught: by the style of reference motions, by tracking the one nearest in speed joint by joint, by a
clock of foot contacts, or not at all."""
Guidance = Literal["path", "translation", "style", "none"]
"""What guides mounting and dismounting: positions and orientations of the key bodies, positions only, the style of
reference motions, nothing."""


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
    turn_time: float = 1.2
    """Longest time that the guidance spreads a turn over [s]; inf for the paper's form."""
    tilt_tolerance: float = 0.05
    """Tolerance of the reward for the asked tilt [rad]; the release's 0.02 pays nothing to a learner whose
    deck still swings by 0.1."""
    smoothness: float = 0.05
    """Weight of the squared first and second differences of the actions; the paper has 0.1."""
    speed_tolerance: float = 0.25
    """Tolerance of the reward for the board's speed while pushing [m^2/s^2]."""
    coupling: Coupling = "equality"
    steered: bool = True
    """Whether tilting steers at all; without it the board goes straight."""
    terrain: Terrain = "flat"
    turn_feedback: bool = True
    """Whether the actor sees how far it still has to turn, as its own yaw tells; else the turn as it was told,
    as in the paper, and it steers blindly."""
    idle_patience: float = 1.2
    """Time in pushing without the left foot on the ground after which an episode ends [s]; 0 for never."""
    speed: tuple[float, float] = (0.0, 1.5)
    """Range of the commanded speed [m/s]."""
    turn: float = math.pi / 4
    """Largest commanded change of heading to either side [rad]."""
    start: Start = field(default_factory=Start)
    boards: int = 64
    """Number of boards drawn from the posterior; 0 trains on the record itself."""
    spread: Spread = field(default_factory=Spread)
    """How they are drawn."""
    pushes: float = 0.5
    """Largest change of velocity by external pushes [m/s]; 0 for none."""
    mount_steps: int = 30
    """Length of mounting in policy steps."""
    bezier_order: int = 2
    lift: float = 0.2
    """Lift of the inner control points of the transition's path [m]."""
    pose_offset: float = 0.0
    """Perturbation of the canonical poses: this much is added to every joint [rad]."""
    noise: bool = True
    """Noise on the actor's observation."""
    episode: float = 20.0
    """Length of an episode [s]."""

    @property
    def styled(self) -> bool:
        """Whether anything is taught by the style of reference motions."""
        return self.pushing == "amp" or self.transition == "style"
