"""The ladder of models: the error with one effect more each time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sysid.board import Board
from sysid.effects import effect
from sysid.fitting.joint import FitOptions, fit_joint, options_for
from sysid.fitting.result import JointFit
from sysid.progress import stage, steps
from sysid.roll import Array, Release

PLAIN = "spring and damper"
"""The simplest model."""


@dataclass(frozen=True, slots=True)
class Rung:
    """One model of a ladder, from the linear joint up."""

    label: str
    """The effect that it adds."""
    fit: JointFit
    heldout_rmse: float
    """On releases that were left out [rad or rad/s]; NaN where that was not asked for."""

    @property
    def rmse(self) -> float:
        """On the releases that were fitted [rad or rad/s]."""
        return self.fit.rmse

    @property
    def simulated(self) -> tuple[Array, ...]:
        """Each fitted release as the model has it [rad or rad/s], shapes (n,)."""
        pairs = zip(self.fit.records, self.fit.residuals, strict=True)
        return tuple(record.signal + residual for record, residual in pairs)


def ladder(
    releases: Sequence[Release],
    board: Board,
    effects: Sequence[str],
    options: FitOptions,
) -> Iterator[Rung]:
    """Fit the linear joint, then the joint with one effect more each time.

    Args:
        effects: In the order in which they are added.

    Raises:
        SysidError: A model cannot be fitted; those before it have been returned.
    """
    known = [name for name in effects if effect(name).is_known]
    added = [name for name in effects if name not in known]
    for count in steps(range(len(added) + 1), lambda n: rung_name(added[:n])):
        names = [*known, *added[:count]]
        with stage(0.0, 0.6):
            fitted = fit_joint(releases, board, names, options_for(options, names, board))
        with stage(0.6, 1.0):
            error = fitted.heldout_rmse()
        yield Rung(rung_name(added[:count]), fitted, error)


def rung_name(effects: Sequence[str]) -> str:
    """Return the label of a model with some effects."""
    return f"+ {effects[-1]}" if effects else PLAIN
