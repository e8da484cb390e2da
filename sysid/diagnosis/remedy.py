"""What is done about what no effect explains: it is learned, and said in words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.board import Board
from sysid.diagnosis.judgement import TIE
from sysid.errors import SysidError
from sysid.fit_mjcf import Fit, fit
from sysid.fitting.formula import spread
from sysid.fitting.record_update import require_usable
from sysid.fitting.records import Signal
from sysid.roll import Release

REACHED = 1.15
"""Error over the noise floor up to which nothing is left to explain."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Learned:
    """A learned torque that can be had, and what it would win."""

    error_after: float
    """On the releases [rad or rad/s]."""
    heldout_rmse: float
    """On releases that were left out [rad or rad/s]."""
    formula: tuple[str, ...]
    """Names of the shapes that come nearest; empty where none does."""
    known: bool
    """Whether the catalogue has these shapes."""
    text: str
    smooth: bool
    """Whether it is a torque of tilt and rate alone: with nothing that sticks or remembers beside it."""
    spread: float
    """Noise that its residuals speak of, for the directions that it took out of them [rad or rad/s]."""
    compared: str
    """Whether the nearest formula is as good as the tables, in words."""
    refused: str = ""
    """Why `fit` would not record it; '' where it would."""

    def gain(self, named: float, samples: float) -> float:
        """Return how much likelier than what is named it makes the log [nats].

        Args:
            named: Error of what is named [rad or rad/s].
            samples: How many of its residuals are independent.
        """
        return samples * float(np.log(named / self.spread))

    def is_unmet(self, named: float, samples: float, floor: float, enough: float) -> bool:
        """Return whether a law that the catalogue lacks reaches the noise, and is likelier beyond doubt than what is named.

        A formula says so by itself. Tables bend to much, but where they alone leave nothing, nothing else need be there.

        Args:
            named: Error of what is named [rad or rad/s].
            samples: How many of its residuals are independent.
            floor: Noise [rad or rad/s].
            enough: Error beyond that of tables from which what is named is not their law [rad or rad/s].
        """
        unknown = not self.known if self.formula else self.smooth and named**2 - self.spread**2 > enough**2
        return unknown and self.spread < REACHED * floor and self.gain(named, samples) > 2 * TIE

    def to_json(self, per: float = 1.0) -> dict[str, Any]:
        """Return it for JSON; `per` turns its errors into angles."""
        return {
            "error_after_rad": per * self.error_after, "heldout_rmse_rad": per * self.heldout_rmse,
            "formula": " + ".join(self.formula), "text": self.text,
        }  # fmt: skip


def tables(
    releases: Sequence[Release],
    board: Board,
    effects: Sequence[str],
    *,
    signal: Signal,
    fixed: Mapping[str, float] | None,
    whole: bool = False,
) -> Fit | None:
    """Learn the torque that some releases show beyond the record and what was named, as tables; None where no fit is found.

    Args:
        releases: From one board.
        board: The record.
        effects: What the verdict names.
        signal: What is fitted.
        fixed: Parameters held.
        whole: Whether formula and held-out error, which take as long again, are worked out at once, as they will be asked for.
    """
    try:
        found = fit(releases, board, (*effects, "learned"), signal=signal, fixed=fixed, any_period=True)
    except SysidError:  # what the verdict rests on stands without it
        return None
    if whole and found.formula is not None:
        _ = found.heldout_rmse
    return found


def residual_noise(found: Fit) -> float:
    """Return the noise that the residuals of tables speak of [rad or rad/s]."""
    return spread(found.joint.problem, found.joint.minimum)


def described(found: Fit, effects: Sequence[str]) -> Learned | None:
    """Return what is said of tables that were learned beside some effects; None where they are flat."""
    if found.formula is None:
        return None
    try:
        require_usable(found.joint)
        refused = ""
    except SysidError as error:
        refused = str(error)
    remembers = any(part.states for part in found.law.structure.parts if part.role == "learned")
    text = f"Learned from tilt and rate, it {found.formula.text}"
    says_it = found.formula.good or found.formula.error < REACHED * found.noise.std
    return Learned(
        error_after=found.rmse, heldout_rmse=found.heldout_rmse, text=text,
        formula=tuple(shape.name for shape in found.formula.shapes) if says_it else (),
        known=found.formula.is_known, smooth=not effects and not remembers, spread=residual_noise(found),
        compared=found.formula.compared(is_rate=found.is_rate), refused=refused,
    )  # fmt: skip
