"""Options of a driven joint."""

from dataclasses import dataclass
from typing import Annotated, Literal

from cyclopts import Group, Parameter

DRIVE = Group("Drive", sort_key=1)


@Parameter(name="*", group=DRIVE)
@dataclass(frozen=True, kw_only=True)
class DriveArguments:
    """Input of a driven joint."""

    input: str | None = None
    """Column with the input; with --joint all, the common beginning of the columns' names."""
    input_is: Literal["torque", "force", "current", "voltage", "command"] | None = None
    """Kind of the input; a command is the position for a servo or a controller."""
    input_unit: float | Literal["rad", "deg"] | None = None
    """Unit of the input, or the size of one unit in SI; by default that of the position for a command, else N·m, A or V."""
    zero: float = 0.0
    """Reading of the position at the model's zero, in its column's unit, such as 2048 counts; a command has the same zero."""
    input_between: Literal["auto", "held", "smooth"] = "held"
    """The input between samples: held by a controller, or smooth; `auto` takes the likelier one, where there is a fit."""
    gains: Annotated[tuple[float, ...], Parameter(consume_multiple=True, show_default=False)] = ()
    """Gains instead of the model's: kp and kd of a command, or the torque of one unit of the input."""
    encoder: Literal["joint", "motor"] = "joint"
    """Side of the gear on which the angle is measured."""

    @property
    def given(self) -> bool:
        """Whether the joint is driven."""
        return self.input is not None or self.input_is is not None
