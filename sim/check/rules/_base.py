"""What a rule is, and what it looks at."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from sim.check.decays import SceneCheck
from sim.compensation.parasitics import Parasitics
from sim.compensation.scene import ClampedScene
from sysid.board import Board

Asked = Literal["before", "failed", "passed"]
"""When a rule is asked, and what its words are: before the verdict, why it cannot be a pass; where it is none, what may
be the cause; where it is one, a warning."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """The case that the rules judge."""

    board: Board
    scene: ClampedScene
    decays: SceneCheck
    """Measured and simulated, side by side."""
    parts: Parasitics | None
    """The scene's tilt joint, and what each part of the scene adds to it; None where there is no board about the joint."""

    @property
    def joint(self) -> Parasitics:
        """The same, for rules of a whole board."""
        assert self.parts is not None
        return self.parts

    @property
    def kind(self) -> str:
        """The kind of thing the record describes, in a word."""
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
    """What is wrong, with numbers, units and where it helps the next step; nothing where nothing is."""
    of_board: bool = False
    """Whether it looks at the parts of a whole board."""
    whole_answer: bool = False
    """Whether nothing else is said where it speaks."""
