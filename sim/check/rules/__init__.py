"""Rules of `check`, each a file that is found by being here.

A rule has one to three generators of sentences on a case: `failures`, `causes` of a failure, `warnings` of a pass.
"""

import importlib
import pkgutil
from dataclasses import dataclass
from typing import Literal

from sim.board.clamped import ClampedScene
from sim.check.decays import SceneCheck
from sim.compensation.parasitics import Parasitics
from sysid.board import Board


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """The case that `check` judges: a record, a scene, and its decays beside the measured ones."""

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


def said(kind: Literal["failures", "causes", "warnings"], case: Case) -> tuple[str, ...]:
    """Return the sentences of every rule."""
    rules = [importlib.import_module(f"{__name__}.{name}") for _, name, _ in pkgutil.iter_modules(__path__)]
    return tuple(sentence for rule in rules if hasattr(rule, kind) for sentence in getattr(rule, kind)(case))
