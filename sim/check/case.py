"""The case that `check` judges: a record, a scene, and its decays beside the measured ones."""

from dataclasses import dataclass

from sim.board.clamped import ClampedScene
from sim.check.decays import SceneCheck
from sim.compensation.parasitics import Parasitics
from sysid.board import Board


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """The case that is judged."""

    board: Board
    scene: ClampedScene
    decays: SceneCheck
    """Measured and simulated, side by side."""
    parts: Parasitics | None
    """The scene's tilt joint and the contribution of each part; None for a joint without a board."""

    @property
    def kind(self) -> str:
        """'joint' or 'board', for messages."""
        return "joint" if self.parts is None else "board"
