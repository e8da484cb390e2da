"""A rule of `check`, and the case that it judges."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from sim.check.decays import SceneCheck
from sim.compensation.parasitics import Parasitics
from sim.compensation.scene import ClampedScene
from sysid.board import Board

Asked = Literal["before", "failed", "passed"]
"""When a rule is asked. Its words are then a failure ("before"), a cause of the failure ("failed") or a warning ("passed")."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """The case that the rules judge."""

    board: Board
    scene: ClampedScene
    decays: SceneCheck
    """Measured and simulated, side by side."""
    parts: Parasitics | None
    """The scene's tilt joint and the contribution of each part; None for a joint without a board."""

    @property
    def joint(self) -> Parasitics:
        """The same, for rules of a whole board."""
        assert self.parts is not None
        return self.parts

    @property
    def kind(self) -> str:
        """'joint' or 'board', for messages."""
        return "joint" if self.parts is None else "board"

    @property
    def tilt_range(self) -> float:
        """The deck's own [rad], to either side."""
        return self.board.tilt["range"].value


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """One reason for or against."""

    order: int
    """Rules speak in this order."""
    asked: tuple[Asked, ...]
    says: Callable[[Case], Iterable[str]]
    """Yields sentences with numbers, units and the next step, for each fault."""
    of_board: bool = False
    """Whether it needs the parts of a whole board."""
    whole_answer: bool = False
    """Whether its words replace those of all other rules."""
