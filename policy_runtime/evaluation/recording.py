"""Recording of a simulated ride: one row a policy step, for metrics, pictures and Rerun."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from policy_runtime.evaluation.metrics import Rides
from policy_runtime.robots.simulated import SimulatedRobot
from policy_runtime.runtime import Tick
from sim.skate.cycle.clock import STILL_SPEED, Clock
from sysid.files import atomic_path

MEASURED = (
    *("target_heading", "course", "board_heading", "board_speed", "board_drift"),
    *("left_slip", "left_place", "foot_on_ground", "foot_on_deck"),
)
"""Fields of `Rides` that are columns of the same names."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A finished recording."""

    columns: dict[str, Any]
    """Numbers of each policy step, first axis the steps (t). Those of `Truth` by their names, and those that `Recorder` adds."""
    weight: float
    """Of the robot [N]."""

    def column(self, name: str) -> Any:
        """Return one number or vector over time, shape (t,) or (t, k)."""
        return self.columns[name]

    def rides(self, *, succeeded: bool) -> Rides:
        """Return the recording as a single episode, for `metrics.episode_errors`."""
        own = {name: values[:, None] for name, values in self.columns.items()}
        stands, step, clock = own["command"][..., 0] < STILL_SPEED, own["step"], Clock()
        return Rides(
            alive=np.ones(step.shape, dtype=bool),
            pushing=clock.pushing(step) & ~stands,
            steering=clock.steering(step),
            still=clock.waiting(step, stands),
            commanded_speed=own["command"][..., 0],
            tilt=-own["roll"],
            joint_position=own["joints"],
            power=np.abs(own["torque"] * own["rates"]).sum(axis=-1) / self.weight,
            ground_load=own["ground_load"][..., 0],
            succeeded=np.array([succeeded]),
            **{name: own[name] for name in MEASURED},
        )

    def save(self, path: Path) -> None:
        """Write the numbers as a NumPy archive."""
        with atomic_path(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **self.columns)


@dataclass
class Recorder:
    """Collects ticks of a simulated robot: give `add` to the runtime as `on_tick`."""

    robot: SimulatedRobot
    _rows: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])

    def add(self, tick: Tick) -> None:
        """Record the moment of one decision, before its consequences; `target_heading` is the heading to reach [rad]."""
        truth, state = self.robot.truth(), tick.state
        begins = not self._rows or Clock().begins_steering(tick.step)
        heading = truth.board_heading + tick.command.turn if begins else self._rows[-1]["target_heading"]
        self._rows.append(
            {
                "time": tick.time,
                "step": tick.step,
                "command": tick.command,
                "qpos": self.robot.data.qpos.copy(),
                "target": tick.target,
                "action": tick.action,
                "target_heading": heading,
                "course": tick.course,
                "torque": state.joint_torque,
                "joints": state.joint_position,
                "rates": state.joint_velocity,
                **{one.name: getattr(truth, one.name) for one in fields(truth)},
            }
        )

    def __len__(self) -> int:
        """Return the number of ticks recorded."""
        return len(self._rows)

    def recording(self) -> Recording:
        """Return everything recorded so far, at least one tick."""
        columns = {name: np.array([row[name] for row in self._rows]) for name in self._rows[0]}
        return Recording(columns, self.robot.ids.weight)
