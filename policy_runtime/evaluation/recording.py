"""Recording of a simulated ride: one row a policy step, for metrics, pictures and Rerun."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from policy_runtime.evaluation.metrics import Rides
from policy_runtime.robots.simulated import SimulatedRobot, Truth
from policy_runtime.runtime import Tick
from sim.skate.cycle.clock import STILL_SPEED, Clock
from sysid.files import atomic_path
from sysid.roll import Array

MEASURED = (
    *("board_heading", "board_speed", "board_drift"),
    *("left_slip", "left_place", "foot_on_ground", "foot_on_deck"),
)
"""Fields of `Rides` that `Truth` has by the same names."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A finished recording; first axis policy steps (t)."""

    time: Array
    """[s], (t,)."""
    step: Array
    """Policy steps since the cycle began, (t,)."""
    command: Array
    """Speed [m/s] and turn [rad], (t, 2)."""
    qpos: Array
    """Configuration of the whole scene, (t, nq)."""
    target: Array
    """Joint targets [rad], (t, 23)."""
    action: Array
    """(t, 23)."""
    target_heading: Array
    """Heading to reach [rad], (t,)."""
    course: Array
    """Sum of the turns asked for since the start [rad], (t,)."""
    torque: Array
    """[N*m], (t, 23)."""
    joints: Array
    """[rad], (t, 23)."""
    rates: Array
    """Joint velocities [rad/s], (t, 23)."""
    weight: float
    """Of the robot [N]."""
    truth: tuple[Truth, ...]
    """(t,)."""

    def column(self, name: str) -> Any:
        """Return one number or vector of the truth over time, shape (t,) or (t, k)."""
        return np.array([getattr(truth, name) for truth in self.truth])

    def rides(self, *, succeeded: bool) -> Rides:
        """Return the recording as a single episode, for `metrics.episode_errors`."""
        stands, step = self.command[:, 0] < STILL_SPEED, self.step.astype(int)
        clock = Clock()
        power = np.abs(self.torque * self.rates).sum(axis=1) / self.weight
        return Rides(
            alive=np.ones((len(step), 1), dtype=bool),
            pushing=(clock.pushing(step) & ~stands)[:, None],
            steering=clock.steering(step)[:, None],
            still=clock.waiting(step, stands)[:, None],
            commanded_speed=self.command[:, :1],
            target_heading=self.target_heading[:, None],
            course=self.course[:, None],
            tilt=-self.column("roll")[:, None],
            joint_position=self.joints[:, None],
            power=power[:, None],
            ground_load=self.column("ground_load")[:, None, 0],
            succeeded=np.array([succeeded]),
            **{name: self.column(name)[:, None] for name in MEASURED},
        )

    def save(self, path: Path) -> None:
        """Write the numbers as a NumPy archive."""
        with atomic_path(path) as temporary, temporary.open("wb") as file:
            own = {field.name for field in fields(self)} - {"truth", "weight"}
            columns: dict[str, Any] = {name: getattr(self, name) for name in own}
            columns |= {field.name: self.column(field.name) for field in fields(Truth)}
            np.savez_compressed(file, **columns)


@dataclass
class Recorder:
    """Collects ticks of a simulated robot: give `add` to the runtime as `on_tick`."""

    robot: SimulatedRobot
    _ticks: list[Tick] = field(default_factory=list[Tick])
    _truth: list[Truth] = field(default_factory=list[Truth])
    _qpos: list[Array] = field(default_factory=list[Array])
    _headings: list[float] = field(default_factory=list[float])

    def add(self, tick: Tick) -> None:
        """Record the moment of one decision, before its consequences."""
        truth = self.robot.truth()
        if not self._headings or Clock().begins_steering(tick.step):
            heading = truth.board_heading + tick.command.turn
        else:
            heading = self._headings[-1]
        self._headings.append(heading)
        self._ticks.append(tick)
        self._truth.append(truth)
        self._qpos.append(self.robot.data.qpos.copy())

    def __len__(self) -> int:
        """Return the number of ticks recorded."""
        return len(self._ticks)

    def recording(self) -> Recording:
        """Return everything recorded so far."""
        ticks = self._ticks
        return Recording(
            time=np.array([tick.time for tick in ticks]),
            step=np.array([tick.step for tick in ticks], dtype=np.float64),
            command=np.array([tick.command for tick in ticks], dtype=np.float64).reshape(-1, 2),
            qpos=np.array(self._qpos),
            target=np.array([tick.target for tick in ticks]),
            action=np.array([tick.action for tick in ticks]),
            target_heading=np.array(self._headings),
            course=np.array([tick.course for tick in ticks]),
            torque=np.array([tick.state.joint_torque for tick in ticks]),
            joints=np.array([tick.state.joint_position for tick in ticks]),
            rates=np.array([tick.state.joint_velocity for tick in ticks]),
            weight=self.robot.ids.weight,
            truth=tuple(self._truth),
        )
