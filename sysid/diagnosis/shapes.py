"""Formulas that a learned torque is compared with, and their words."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from sysid.effects import catalogue, effect_file
from sysid.effects._algebra import NUMPY
from sysid.roll import Array
from sysid.text import display

MIN_SHARE = 0.5
"""Share of the learned torque below which the nearest formula does not describe it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """One formula."""

    name: str
    code: str
    """Torque for a coefficient of 1, in the language of an effect file: x [rad], v [rad/s], a [rad] and the algebra m."""
    text: str
    """The term as a formula; {a} is its width or angle."""
    words: str
    """Its action; {a} is its width, {a2} twice that."""
    causes: str = ""
    """Possible causes."""
    opposite: tuple[str, str] = ("", "")
    """Action and causes for a negative coefficient; '' if the words fit both signs."""
    widths: tuple[float, ...] = ()
    """Widths that are tried, over the largest tilt."""
    unit: str = ""
    """Unit of its coefficient."""

    def torque(self, tilt: Array, rate: Array, width: float) -> Array:
        """Return the torque for a coefficient of 1 at tilts [rad] and rates [rad/s], shape (n,)."""
        return np.asarray(_law(self.code)(NUMPY, tilt, rate, width) + 0.0 * tilt)

    def said(self, coefficient: float, width: float, peak: float, *, slides: bool) -> tuple[str, str]:
        """Return its action and its causes in words.

        Args:
            coefficient: Its coefficient; the sign counts.
            width: Its width [rad].
            peak: Largest torque that it reaches beside spring and damper [N*m].
            slides: Whether the joint slides.
        """
        pair = (self.words, self.causes)
        words, causes = self.opposite if coefficient < 0 and self.opposite[0] else pair
        show = display(is_rate=False, slides=slides)
        return (
            f"{words.format(a=show(width, 3), a2=show(2 * width, 3))}, {peak:.2g} {'N' if slides else 'N·m'}",
            causes,
        )


@cache
def _law(code: str) -> Callable[..., Any]:
    return eval(f"lambda m, x, v, a: {code}")  # `code` is a constant of this file


_ANGLES = tuple(np.linspace(0.1, 0.9, 33))
_WIDTHS = tuple(np.geomspace(0.02, 0.4, 25))
_WAVES = tuple(1 / np.linspace(0.5, 8, 76))
SHAPES: tuple[Shape, ...] = (
    Shape(
        name="magnet", code="-x * m.exp(-0.5 * (x / a) ** 2)", text="x exp(-½ (x/{a})²)", words="a pull to the middle within {a2}",
        causes="a magnet, a detent", opposite=("a push away from the middle within {a2}", "a dead centre, a repelling magnet"),
        widths=_WIDTHS, unit="N*m/rad",
    ),
    Shape(
        name="magnet with wide tails", code="-x / (1 + (x / a) ** 2) ** 2", text="x/(1 + (x/{a})²)²",
        words="a pull to the middle within {a}", causes="a magnet",
        opposite=("a push away from the middle within {a}", "a repelling magnet"), widths=_WIDTHS, unit="N*m/rad",
    ),
    Shape(
        name="cogging", code="-m.sin(6.283185307 * x / a)", text="sin(360° x/{a})", words="waves of {a}",
        causes="cogging, teeth or poles of a motor", widths=_WAVES, unit="N*m",
    ),
    Shape(
        name="right bumper", code="-m.maximum(x - a, 0.0)", text="max(x - {a}, 0)", words="a stop beyond {a} on the right only",
        causes="a bumper on one side", opposite=("a spring that lets go beyond {a} on the right only", ""), widths=_ANGLES,
        unit="N*m/rad",
    ),
    Shape(
        name="left bumper", code="m.maximum(-x - a, 0.0)", text="min(x + {a}, 0)", words="a stop beyond {a} on the left only",
        causes="a bumper on one side", opposite=("a spring that lets go beyond {a} on the left only", ""), widths=_ANGLES,
        unit="N*m/rad",
    ),
    Shape(
        name="fifth power", code="-x**5", text="x⁵", words="hardening at wide angles only (like x⁵)", causes="compressed rubber",
        opposite=("softening at wide angles only (like x⁵)", ""), unit="N*m/rad^5",
    ),
    Shape(
        name="cubic", code="-x**3", text="x³", words="hardening (like x³)", opposite=("softening (like x³)", ""), unit="N*m/rad^3",
    ),
    Shape(
        name="square", code="-x * m.abs(x)", text="x|x|", words="hardening in proportion to the angle (like x|x|)",
        opposite=("softening in proportion to the angle (like x|x|)", ""), unit="N*m/rad^2",
    ),
    Shape(
        name="lopsided square", code="-(x**2)", text="x²", words="stiffness that grows to one side (like x²)", unit="N*m/rad^2",
    ),
    Shape(
        name="lopsided", code="-m.abs(x)", text="|x|", words="a spring stiffer on one side (like |x|)", unit="N*m/rad",
    ),
    Shape(
        name="one-way damper", code="-m.abs(v)", text="|v|", words="more damping in one direction (like max(v, 0))",
        causes="a one-way damper", unit="N*m*s/rad",
    ),
    Shape(
        name="root of the rate", code="-v / (m.abs(v) + 1e-6) ** 0.5", text="sgn v √|v|",
        words="friction like the root of the rate", causes="a seal, a thin film", unit="N*m*s^0.5/rad^0.5",
    ),
    Shape(
        name="dry friction", code="-v / (m.abs(v) + 1e-3)", text="sgn v", words="friction alike at all rates",
        causes="dry friction", unit="N*m",
    ),
    Shape(
        name="quadratic drag", code="-v * m.abs(v)", text="v|v|", words="drag (like v|v|)", causes="air, oil",
        unit="N*m*s^2/rad^2",
    ),
    Shape(name="cubic drag", code="-v**3", text="v³", words="drag (like v³)", unit="N*m*s^3/rad^3"),
    Shape(
        name="damping by the tilt", code="-m.abs(x) * v", text="|x| v", words="damping that grows with angle (like |x| v)",
        opposite=("damping that falls with angle (like |x| v)", ""), unit="N*m*s/rad^2",
    ),
    Shape(
        name="damping by the tilt squared", code="-x * x * v", text="x² v", words="damping that grows with angle (like x² v)",
        causes="compressed rubber, a linkage", opposite=("damping that falls with angle (like x² v)", ""), unit="N*m*s/rad^3",
    ),
    Shape(
        name="damping on one side", code="-x * v", text="x v", words="more damping on one side (like x v)", unit="N*m*s/rad^2",
    ),
    Shape(
        name="drag to one side", code="-v * v", text="v²", words="a push to one side at high rates (like v²)",
        unit="N*m*s^2/rad^2",
    ),
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Formula:
    """The formula nearest to a learned torque."""

    shapes: tuple[Shape, ...]
    coefficients: tuple[float, ...]
    """In the units of the shapes."""
    widths: tuple[float, ...]
    """Widths, angles or wave lengths [rad]; 0 for a shape without one."""
    peaks: tuple[float, ...]
    """Largest torque of each term beside spring and damper [N*m]."""
    share: float
    """Share of the tables' log likelihood that the formula gains too [1]."""
    good: bool
    """Whether the formula is as likely as the tables."""
    slides: bool = False
    """Whether the joint slides, so that widths are lengths."""

    @property
    def terms(self) -> tuple[str, ...]:
        """Its terms without their coefficients, e.g. 'x exp(-½ (x/0.7°)²)'."""
        show = display(is_rate=False, slides=self.slides)
        pairs = zip(self.shapes, self.widths, strict=True)
        return tuple(shape.text.format(a=show(width, 3)) for shape, width in pairs)

    @property
    def law(self) -> str:
        """The terms in a sum."""
        return " + ".join(self.terms)

    @property
    def text(self) -> str:
        """Its action, its causes, and the share of the learned torque that it carries."""
        carries = f"carries {100 * self.share:.0f} % of it"
        if self.share <= MIN_SHARE:
            return f"no formula of the library is like it; the nearest ({self.law}) {carries}"
        terms = zip(self.shapes, self.coefficients, self.widths, self.peaks, strict=True)
        said = [shape.said(*numbers, slides=self.slides) for shape, *numbers in terms]
        causes = ", ".join(dict.fromkeys(cause for _, cause in said if cause))
        why = f". Possible causes: {causes}" if causes else ""
        return f"{' and '.join(action for action, _ in said)}; this formula {carries}{why}"

    def torque(self, tilt: Array, rate: Array) -> Array:
        """Return the torque [N*m] at tilts [rad] and rates [rad/s], shape (n,) each."""
        terms = zip(self.shapes, self.coefficients, self.widths, strict=True)
        return sum((c * shape.torque(tilt, rate, width) for shape, c, width in terms), 0.0 * tilt)

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects of the catalogue with the same law; empty if one of its terms is in none."""
        laws = {
            part.formula.split("} ")[-1].replace("φ̇", "v").replace("φ", "x"): n
            for n, part in catalogue().items()
        }
        names = tuple(laws.get(shape.text, "") for shape in self.shapes)
        return names if all(names) else ()

    def own_effect(self) -> tuple[str, str]:
        """Return name and Python source of an effect with this law."""
        name = re.sub("[^a-z]+", "-", " and ".join(shape.name for shape in self.shapes))
        terms: list[str] = []
        parameters: list[tuple[str, str, str, float]] = []
        for i, (shape, c, width) in enumerate(
            zip(self.shapes, self.coefficients, self.widths, strict=True), 1
        ):
            code = re.sub(r"\ba\b", f'parameters["width_{i}"]', shape.code)
            terms.append(f'parameters["coefficient_{i}"] * ({code})')
            parameters.append((f"coefficient_{i}", shape.unit, f"{abs(c):.3g}", c))
            if shape.widths:
                parameters.append((f"width_{i}", "rad", f"{width:.3g}", width))
        does = self.text.split(";")[0]
        source = effect_file(
            name, title=does, does=f"{does[0].upper()}{does[1:]}.", law=" + ".join(terms),
            text=f"τ ∝ -{' - '.join(self.terms)}", source="read off a learned torque", parameters=parameters,
        )  # fmt: skip
        return name, source
