# pyright: reportMissingImports=false
# (onnx is optional.)
"""Check for observations outside the training distribution: live observations against the file's own normaliser.

A policy file begins with the mean and standard deviation of everything it saw in training. A sensor whose axis is
turned, a joint in another order or unit, a robot in another pose stand out in units of that deviation. Command,
phase and last action are left out, because they are no measurements.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from policy_runtime.loop.policy import OnnxPolicy
from policy_runtime.robots import RobotState
from sim.skate.robot.g1 import JOINTS
from sysid.errors import SysidError, needs_extra
from sysid.roll import Array

MAX_STDS = 5.0
"""Standard deviations from the training's mean beyond which a number was hardly ever seen."""
MIN_STEP_SHARE = 0.02
"""Share of steps beyond that which is no glitch."""


@dataclass(frozen=True, slots=True)
class Seen:
    """One number of the observation: live beside training, in the units of the policy's input."""

    name: str
    live: tuple[float, float]
    """Least and greatest."""
    mean: float
    """In training."""
    std: float
    """In training."""
    far: float
    """Share of steps further than `MAX_STDS` standard deviations from the training's mean."""

    @property
    def worst(self) -> float:
        """Greatest distance from the training's mean, in standard deviations."""
        return max(abs(value - self.mean) for value in self.live) / self.std


class RangeCheck:
    """Collects the observations of a policy."""

    def __init__(self, policy: OnnxPolicy) -> None:
        """Read the normaliser of the policy's file."""
        self._policy = policy
        names = policy.observing.names
        sensed = [
            i for i, name in enumerate(names) if name.split()[0] not in ("command", "last_action", "phase")
        ]
        self._names = [names[i] for i in sensed]
        self._places = policy.observing.newest[sensed]
        self._mean, self._std = (values[self._places] for values in normaliser(policy))
        self._rows: list[Array] = []
        self.first_move = ("", 0.0)
        """Which joint the first answer would have moved furthest, and by how much [rad]."""

    def add(self, state: RobotState, target: Array) -> None:
        """Take the policy's last observation, and its joint targets [rad], shape (23,)."""
        if not self._rows:
            moves = target - state.joint_position
            worst = int(np.abs(moves).argmax())
            self.first_move = JOINTS[worst], float(moves[worst])
        self._rows.append(self._policy.observation[self._places])

    def seen(self) -> list[Seen]:
        """Return every sensor's number of a frame, the furthest from training first."""
        rows = np.array(self._rows).reshape(-1, len(self._mean))
        if not len(rows):
            return []
        far = (np.abs(rows - self._mean) > MAX_STDS * self._std).mean(axis=0)
        numbers = [
            Seen(name, (float(low), float(high)), float(mean), float(std), float(share))
            for name, low, high, mean, std, share in zip(
                self._names, rows.min(0), rows.max(0), self._mean, self._std, far, strict=True
            )
        ]
        return sorted(numbers, key=lambda number: -number.worst)

    def outside(self) -> list[Seen]:
        """Return the numbers that were far from the training more than now and then."""
        return [number for number in self.seen() if number.far > MIN_STEP_SHARE]

    def to_json(self) -> dict[str, Any]:
        """Return it for machines."""
        joint, move = self.first_move
        return {
            "steps": len(self._rows),
            "first_move": {"joint": joint, "rad": move},
            "numbers": [{**asdict(n), "live": list(n.live), "worst_z": n.worst} for n in self.seen()],
        }


def normaliser(policy: OnnxPolicy) -> tuple[Array, Array]:
    """Return mean and standard deviation by which a policy's file normalises its input, each of shape (size,)."""
    with needs_extra("run", "reading what a policy was trained on"):
        import onnx
        from onnx import numpy_helper
    graph = onnx.load(str(policy.file.path)).graph
    constants = {value.name: numpy_helper.to_array(value) for value in graph.initializer}
    constants |= {
        node.output[0]: numpy_helper.to_array(node.attribute[0].t)
        for node in graph.node
        if node.op_type == "Constant"
    }
    found: dict[str, Array] = {}
    name = policy.file.input_name
    for kind in ("Sub", "Div"):
        node = next((node for node in graph.node if node.op_type == kind and node.input[0] == name), None)
        if node is None or node.input[1] not in constants:
            raise SysidError(
                f"{policy.file.path}: does not begin with a normaliser, so its range in training is unknown."
            )
        found[kind], name = constants[node.input[1]].reshape(-1).astype(np.float64), node.output[0]
    return found["Sub"], found["Div"]
