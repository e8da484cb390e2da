# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""Domain randomisation: every world's own place within a `Variation`, scaled by one strength.

Each place is drawn once and kept. Raising the strength from 0 to 1 moves a world gradually from the nominal one
to its own, without a reset.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
import warp as wp
from mjlab.managers.event_manager import RecomputeLevel

from sim.board.scene import WHEELS
from sim.skate import rotation
from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.mdp.actor_observation import FRAME_SIZE, PARTS
from sim.skate.mdp.ledges import Ledges
from sim.skate.world.scene import DECIMATION, TIMESTEP
from sim.skate.world.terrain import LEDGE, STEP_LENGTH

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv

MEMORY = 3
"""Policy steps that delays reach over, the present one included."""
LEVEL_SHARE, ASCENT_SHARE, DESCENT_SHARE = 0.3, 0.35, 0.2
"""Shares of the segments of ground that are level, long ways up and short ways down; the others are long ways
down. Of the way, a third is level: a rider who hardly sees the slope must not take every ground for one."""
LONG, SHORT = (3.0, 20.0), (1.0, 4.0)
"""How long segments of ground are, evenly spread in the logarithm: level ones and long slopes, short ways down [m]."""
LEDGE_EVERY = STEP_LENGTH
"""Mean way from one ledge to the next [m]: as on the suite's ground. Half as many taught less, even where they were higher."""
MAX_SLOPE_ANGLE = math.pi / 4
"""Largest angle between a slope and where the board points at its beginning [rad]."""
EDGE = 0.1
"""Way within which the ground goes over from one segment to the next [m]."""
_SENSORS = ("angular_velocity", "gravity", "joint_position", "joint_velocity")
"""Parts of the actor's frame that sensors measure."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Variation:
    """How far robots, boards, grounds and sensors differ from world to world, at full strength.

    Each world draws its place within these ranges once. The strength, from 0 to 1, scales the way from the
    nominal value to the drawn one.
    """

    action_delay: float = 0.08
    """Longest time from the policy's answer to the servos [s]; two policy steps count where it is longer. At the strength that
    policies come to, 0.3 to 0.5, it is 24 to 40 ms."""
    sensor_delay: float = 0.02
    """Longest time from the sensors to the policy [s]; at most two policy steps."""
    gains: float = 0.15
    """Relative half-width of the servos' kp and kd, each joint on its own."""
    masses: float = 0.10
    """Relative half-width of masses and inertias of the robot's links, each on its own."""
    rolling_friction: tuple[float, float] = (0.5, 4.0)
    """Factors of the wheels' rolling friction, evenly spread in their logarithm."""
    slope: float = math.radians(8.0)
    """Steepest long slope [rad], up or down, ahead within 45°. At the strength that policies come to, 0.3 to 0.5, it is the
    3° uphill on which slow ones fell."""
    descent: float = math.radians(10.0)
    """Steepest short way down, ahead within 45° [rad]."""
    ledge: float = 0.14
    """Highest ledge to roll down [m]. At the strength that policies come to, 0.4 to 0.5, it is the 60 mm of the suite's ground."""
    gyro_bias: float = 0.03
    """[rad/s]"""
    gravity_bias: float = 0.02
    """Error of the direction of gravity [rad]."""
    encoder_bias: float = 0.015
    """[rad]"""


class Worlds:
    """mjlab's startup event that draws the worlds; the curriculum calls `set_strength` afterwards."""

    model_fields = (
        "body_mass",
        "body_inertia",
        "body_subtreemass",
        "dof_invweight0",
        "body_invweight0",
        "tendon_length0",
        "tendon_invweight0",
        "actuator_acc0",
        "actuator_gainprm",
        "actuator_biasprm",
        "geom_friction",
    )
    """Fields that mjlab keeps for each world."""

    def __init__(self, cfg: Any, env: "ManagerBasedRlEnv") -> None:
        """Draw every world's place."""
        self.variation = variation = Variation()
        self.strength = torch.ones((), device=env.device)
        """Share of the variation by which worlds differ, in one place in memory, ()."""
        self._env = env
        n, device, model = env.num_envs, env.device, env.sim.mj_model
        draw = lambda *shape: torch.rand(n, *shape, device=device)  # noqa: E731
        self._links = [i for i in range(model.nbody) if model.body(i).name.startswith("robot/")]
        self._servos = [i for i in range(model.nu) if model.actuator(i).name.startswith("robot/")]
        self._wheels = [model.geom(f"board/{wheel}_wheel_collision").id for wheel in WHEELS]
        self._sole = int(model.geom("robot/right_foot1_collision").id)
        self._mass = 2 * draw(len(self._links)) - 1
        self._gains = 2 * draw(len(self._servos), 2) - 1
        self._rolling, self._action_delay, self._sensor_delay = draw(), draw(), draw()
        self._bias = (2 * draw(FRAME_SIZE) - 1) * torch.tensor(_bias_widths(variation), device=device)
        self._measured = torch.tensor([name in _SENSORS for name, size, *_ in PARTS for _ in range(size)])
        self._measured = self._measured.to(device)
        self.action_lag = torch.zeros(n, dtype=torch.long, device=device)
        """Simulation steps from the policy's answer to the servos, (n,)."""
        self.sensor_lag = torch.zeros(n, device=device)
        """Policy steps from the sensors to the policy, (n,)."""
        self.bias = torch.zeros_like(self._bias)
        """Bias of the sensors, in the units of a raw frame, (n, 78)."""
        self.rolling = torch.zeros(n, device=device)
        """Logarithm of the factor of the rolling friction, (n,)."""
        self.mass = torch.zeros(n, device=device)
        """Mean relative deviation of the links' masses, (n,)."""
        self.slope = torch.zeros(n, 2, device=device)
        """Gradient of the ground along x and y [rad], uphill positive, (n, 2)."""
        self._coming = torch.zeros_like(self.slope)
        """The gradient that it goes over to within `EDGE`."""
        self._remaining = torch.zeros(n, device=device)
        """Length of the present segment of ground that is left [m], (n,)."""
        self.ledges = Ledges(env) if LEDGE in (model.geom(i).name for i in range(model.ngeom)) else None
        """None where the ground has a form of its own."""
        self._board_q = model.joint("board/board_free_joint").qposadr[0]
        self._board_v = model.joint("board/board_free_joint").dofadr[0]
        self._world = torch.arange(n, device=device)
        self._weight = float(np.linalg.norm(model.opt.gravity))
        gravity = wp.array(np.tile(model.opt.gravity, (n, 1)), dtype=wp.vec3, device=env.sim.wp_device)
        env.sim.wp_model.opt.gravity = (
            gravity  # one for each world; mjlab makes its graphs anew after the events
        )
        self._gravity = wp.to_torch(gravity)

    def __call__(self, env: "ManagerBasedRlEnv", env_ids: Any, strength: float) -> None:
        """Put every world in its place."""
        self.set_strength(strength)

    def set_strength(self, strength: float) -> None:
        """Let worlds differ by this share of the variation, from 0 to 1."""
        self.strength.fill_(strength)
        sim, variation = self._env.sim, self.variation
        model, default = sim.model, sim.get_default_field
        mass = 1 + strength * variation.masses * self._mass
        self.mass.copy_(mass.mean(-1) - 1)
        model.body_mass[:, self._links] = default("body_mass")[self._links] * mass
        model.body_inertia[:, self._links] = default("body_inertia")[self._links] * mass[..., None]
        kp, kd = (1 + strength * variation.gains * self._gains).unbind(-1)
        gains, biases, own = default("actuator_gainprm"), default("actuator_biasprm"), self._servos
        model.actuator_gainprm[:, own, 0] = gains[own, 0] * kp
        model.actuator_biasprm[:, own, 1] = biases[own, 1] * kp
        model.actuator_biasprm[:, own, 2] = biases[own, 2] * kd
        low, high = (math.log(factor) for factor in variation.rolling_friction)
        self.rolling.copy_(strength * (low + (high - low) * self._rolling))
        friction = default("geom_friction")[self._wheels, 2] * self.rolling.exp()[:, None]
        model.geom_friction[:, self._wheels, 2] = friction
        lag = strength * variation.action_delay / TIMESTEP * self._action_delay
        self.action_lag.copy_(lag.round().long().clamp(max=(MEMORY - 1) * DECIMATION))
        self.sensor_lag.copy_(strength * variation.sensor_delay / CONTROL_PERIOD * self._sensor_delay)
        self.bias.copy_(strength * self._bias)
        sim.recompute_constants(RecomputeLevel.set_const)

    def draw_slope(self, ids: torch.Tensor | slice) -> None:
        """Put some worlds at the beginning of a new segment of ground."""
        gradient, length = self._segment()
        for kept, new in ((self.slope, gradient), (self._coming, gradient), (self._remaining, length)):
            kept[ids] = new[ids]
        if self.ledges is not None:
            self.ledges.clear(ids)
        self._gravity.copy_(-self._weight * self.up())

    def roll_on(self) -> None:
        """Let the ground change under boards that have rolled on for a policy step."""
        velocity = self._env.sim.data.qvel[:, self._board_v : self._board_v + 2]
        # Broken worlds are about to begin anew.
        way = CONTROL_PERIOD * torch.nan_to_num(velocity.norm(dim=-1))
        self._remaining -= way
        over, (gradient, length) = self._remaining < 0, self._segment()
        self._coming.copy_(torch.where(over[:, None], gradient, self._coming))
        self._remaining.copy_(torch.where(over, length, self._remaining))
        if self.ledges is not None:
            due = torch.rand_like(way) < way / LEDGE_EVERY
            self.ledges.roll_on(*self._board(), due, self.strength * self.variation.ledge)
        self.slope += (way / EDGE).clamp(max=1.0)[:, None] * (self._coming - self.slope)
        self._gravity.copy_(-self._weight * self.up())

    def _segment(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Draw gradient [rad], (n, 2), and length [m], (n,), of a segment of ground for every world."""
        n, device = len(self.slope), self.slope.device
        chance, drawn, aside, far = torch.rand(4, n, device=device)
        level, descent = chance < LEVEL_SHARE, chance > 1 - DESCENT_SHARE
        towards = self._board()[1] + MAX_SLOPE_ANGLE * (2 * aside - 1)
        ahead = torch.stack((towards.cos(), towards.sin()), dim=-1)
        steepness = drawn.sqrt()  # the steeper, the more often: they are harder
        steepest = torch.where(descent, self.variation.descent, self.variation.slope)
        slope = torch.where(chance < LEVEL_SHARE + ASCENT_SHARE, steepness, -steepness) * steepest
        low, high = (torch.where(descent, short, long) for short, long in zip(SHORT, LONG, strict=True))
        length = low * (high / low) ** far
        return torch.where(level, 0.0, self.strength * slope)[:, None] * ahead, length

    def _board(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return place in the plane [m], (n, 2), and heading [rad], (n,), of boards; 0 in broken worlds."""
        pose = torch.nan_to_num(self._env.sim.data.qpos[:, self._board_q : self._board_q + 7])
        return pose[:, :2], rotation.yaw(pose[:, 3:])

    def up(self) -> torch.Tensor:
        """Return the vertical as a unit vector in the frame of the ground, (n, 3)."""
        sine = self.slope.sin()
        return torch.cat((sine, (1 - (sine**2).sum(-1, keepdim=True)).sqrt()), dim=-1)

    def answers(self, actions: torch.Tensor) -> torch.Tensor:
        """Return which of the last answers reaches the servos in each simulation step of a policy step.

        Args:
            actions: The last three answers, newest first, (3, n, 23).

        Returns:
            (4, n, 23).
        """
        substep = torch.arange(DECIMATION, device=actions.device)[:, None]
        return actions[steps_back(self.action_lag, substep), self._world]

    def sensed(self, frames: torch.Tensor) -> torch.Tensor:
        """Return the sensor readings of the policy, delayed and with bias; its own last action and command without delay.

        Args:
            frames: The last three true frames, newest first, (3, n, 78).
        """
        whole = self.sensor_lag.floor().long().clamp(max=MEMORY - 2)
        newer, older = frames[whole, self._world], frames[whole + 1, self._world]
        late = newer + (self.sensor_lag - whole)[:, None] * (older - newer)
        return torch.where(self._measured, late, frames[0]) + self.bias

    def known(self) -> torch.Tensor:
        """Return the privileged numbers of each world for the critic, about within ±1, (n, 7)."""
        lag = self.action_lag * (TIMESTEP / CONTROL_PERIOD) - 1
        friction = self._env.sim.model.geom_friction[:, self._sole, 0]
        one = (lag, self.sensor_lag, self.rolling, friction - 1, 5 * self.mass)
        return torch.cat((torch.stack(one, dim=-1), 10 * self.slope), dim=-1)


def steps_back(lag: Any, substep: Any) -> Any:
    """Return how many policy steps ago was answered what arrives after `lag` simulation steps, (...,).

    Args:
        lag: Simulation steps, integers.
        substep: Simulation step within the policy step, from 0.
    """
    return ((lag - substep + DECIMATION - 1) // DECIMATION).clip(min=0, max=MEMORY - 1)


def worlds(env: "ManagerBasedRlEnv") -> Worlds:
    """Return the differing worlds."""
    return env.event_manager.get_term_cfg("worlds").func


def draw_slope(env: "ManagerBasedRlEnv", env_ids: torch.Tensor | None) -> None:
    """Begin on a new segment of ground: mjlab's event of a reset."""
    worlds(env).draw_slope(slice(None) if env_ids is None else env_ids)


def roll_on(env: "ManagerBasedRlEnv", env_ids: None) -> None:
    """Go on over the ground: mjlab's event of every step."""
    worlds(env).roll_on()


def _bias_widths(variation: Variation) -> list[float]:
    widths = {
        "angular_velocity": variation.gyro_bias,
        "gravity": variation.gravity_bias,
        "joint_position": variation.encoder_bias,
    }
    return [widths.get(name, 0.0) for name, size, *_ in PARTS for _ in range(size)]
