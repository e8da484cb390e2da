"""Tables and short texts of a report: plain text for terminal, pipe and notebook."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

    from sysid.quantity import Quantity

WIDTH = 160
"""Width of a report outside a terminal [characters]."""
DEGREES = math.degrees(1.0)
"""One radian [deg]."""


def table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], title: str | None = None, *, width: int = WIDTH
) -> str:
    """Return a table as lines of text; cells are wrapped to fit `width` characters."""
    from io import StringIO

    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    content = Table(title=title, title_justify="left")
    for column in columns:
        content.add_column(escape(column), overflow="fold")
    for row in rows:
        content.add_row(*map(escape, row))  # '[kg]' is a unit, not a style
    text = StringIO()
    Console(file=text, width=width, color_system=None, highlight=False, emoji=False).print(content)
    return text.getvalue().rstrip("\n")


def quantity_frame(quantities: "Mapping[str, Quantity]") -> "pd.DataFrame":
    """Return quantities as rows: value, std, low and high end of the 95 % interval, unit, how."""
    import pandas as pd

    rows = [
        {"value": q.value, "std": q.std, "low": q.ci95[0], "high": q.ci95[1], "unit": q.unit, "how": q.method}
        for q in quantities.values()
    ]
    return pd.DataFrame(rows, index=pd.Index(quantities, name="quantity"))


@dataclass(frozen=True, slots=True)
class Display:
    """Unit and scale in which a position or its rate is displayed."""

    name: str
    unit: str
    scale: float
    """Of one rad, or rad/s, in `unit`."""

    @property
    def axis(self) -> str:
        """Label of an axis."""
        return f"{self.name} [{self.unit.strip()}]"

    def __call__(self, value: float, digits: int = 4) -> str:
        """Return a position [rad or m] or rate [rad/s or m/s] in `unit`."""
        return f"{self.scale * value:.{digits}g}{self.unit}"


def display(*, is_rate: bool, slides: bool = False) -> Display:
    """Return the display of a position or its rate: in degrees and rad/s; of a slide in mm and m/s."""
    if slides:
        return Display("speed", " m/s", 1.0) if is_rate else Display("position", " mm", 1e3)
    return Display("rate", " rad/s", 1.0) if is_rate else Display("angle", "°", DEGREES)


def effort(*, slides: bool) -> str:
    """Return the label of an axis of torque, of force for a slide."""
    return "force [N]" if slides else "torque [N·m]"


def linear_law(inertia: float, damping: float, stiffness: float, rest: float) -> str:
    """Return the left-hand side of a linear joint, e.g. '8.70e-3 φ̈ + 0.402 φ̇ + 14.68 (φ - 0.010)', all SI."""
    moved = round(abs(rest), 3)
    roll = f"(φ {'-' if rest > 0 else '+'} {moved:.3f})" if moved else "φ"
    leading = "φ̈" if inertia == 1 else f"{short(inertia)} φ̈"
    spring = f" + {stiffness:.4g} {roll}" if stiffness else ""
    return f"{leading} + {short(damping)} φ̇{spring}"


def in_brackets(quantity: "Quantity") -> str:
    """Return a value with its 95 % interval, e.g. '0.812 [0.790, 0.833]'; '–' if unknown."""
    if not math.isfinite(quantity.value):
        return "–"
    low, high = quantity.ci95
    return f"{quantity.value:.3f} [{low:.3f}, {high:.3f}]" if math.isfinite(low) else f"{quantity.value:.3f}"


def count(number: int, noun: str) -> str:
    """Return '1 gap', '2 gaps'."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def short(value: float) -> str:
    """Return a number with three digits, below a hundredth as 8.70e-3."""
    if abs(value) >= 0.01 or value == 0:
        return f"{value:.3g}"
    digits, _, power = f"{value:.2e}".partition("e")
    return f"{digits}e{int(power)}"


def percent(share: float) -> str:
    """Return a probability in whole percents."""
    return "over 99 %" if share > 0.99 else f"{100 * share:.0f} %"
