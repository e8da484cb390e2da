"""A learned torque in words: the nearest formula of a small library, and what it may be.

Shapes are ranked by how much worse the releases would be explained with their tables, and the nearest are fitted to the
releases. Whatever is linear in tilt or rate is spring and damper and fits any formula. A shape with a width or an angle of its
own is searched along it.
"""

import itertools
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.effects import catalogue, effect_file
from sysid.effects._algebra import NUMPY, Algebra, Value, Values
from sysid.effects._base import JointState, Parameter, Scales, TorqueEffect
from sysid.effects._unlisted import unlisted
from sysid.effects.learned import tabulated
from sysid.fitting.cross_validation import rms
from sysid.fitting.learned_torque import learned_torque, tables_of
from sysid.fitting.problem import Problem
from sysid.fitting.result import JointFit
from sysid.fitting.smoothing import ZERO_TABLE_WEIGHT, directions, fit_instead
from sysid.joint.trajectory import simulate
from sysid.least_squares import Minimum
from sysid.roll import Array
from sysid.text import display

Law = Callable[[Algebra, Value, Value, float], Value]
"""Of the algebra, tilt [rad], rate [rad/s] and the shape's own width or angle."""
MAX_ERROR_RATIO = 1.02
"""Error of a formula over that of the tables up to which it is as good."""
MIN_SHARE = 0.5
"""Share of what was learned up to which the nearest formula is no word for it."""
SAME_STOP_RATIO = 1.1
"""Ratio of two bumpers' angles up to which they are one stop: each is found to a few percent."""
CANDIDATES = 5
"""How many of the nearest shapes are fitted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """One formula of the library."""

    name: str
    law: Law
    code: str
    """The same in the language of an effect's file, with x, v and a."""
    text: str
    """The term as a formula, with {a} for its width or angle and its unit."""
    words: str
    """What it does and may be, with {a}, {a2} for twice that, and {c}: the torque that it reaches, or what it takes, with its unit."""
    opposite: str = ""
    """The same where the torque drives instead of holding back; '' where that is the same thing."""
    widths: tuple[float, ...] = ()
    """What `a` is tried at, over the largest tilt; a sine's wave length is one too."""
    unit: str = ""
    """Of its coefficient."""

    def __reduce__(self) -> tuple[Callable[[str], "Shape"], tuple[str]]:
        """Travel between processes by name, as a law is code."""
        return _shape, (self.name,)


_ANGLES = tuple(np.linspace(0.1, 0.9, 33))
_WIDTHS = tuple(np.geomspace(0.02, 0.4, 25))
_WAVES = tuple(1 / np.linspace(0.5, 8, 76))
SHAPES: tuple[Shape, ...] = (
    Shape(
        name="magnet", law=lambda m, x, v, a: -x * m.exp(-0.5 * (x / a) ** 2), code="-x * m.exp(-0.5 * (x / a) ** 2)",
        text="x exp(-½ (x/{a})²)", words="pulls to the middle within {a2}: a magnet or a detent; {c}",
        opposite="pushes away from the middle within {a2}: a dead centre or a repelling magnet; {c}", widths=_WIDTHS,
        unit="N*m/rad",
    ),
    Shape(
        name="magnet with wide tails", law=lambda m, x, v, a: -x / (1 + (x / a) ** 2) ** 2, code="-x / (1 + (x / a) ** 2) ** 2",
        text="x/(1 + (x/{a})²)²", words="pulls to the middle within {a}: a magnet; {c}",
        opposite="pushes away from the middle within {a}: a repelling magnet; {c}", widths=_WIDTHS, unit="N*m/rad",
    ),
    Shape(
        name="cogging", law=lambda m, x, v, a: -m.sin(6.283185307 * x / a), code="-m.sin(6.283185307 * x / a)",
        text="sin(360° x/{a})", words="comes in waves of {a}: cogging, teeth or poles of a motor; {c}", widths=_WAVES,
        unit="N*m",
    ),
    Shape(
        name="right bumper", law=lambda m, x, v, a: -m.maximum(x - a, 0.0), code="-m.maximum(x - a, 0.0)",
        text="max(x - {a}, 0)", words="acts beyond {a} on the right only: a bumper on one side; {c}",
        opposite="lets go beyond {a} on the right only; {c}", widths=_ANGLES, unit="N*m/rad",
    ),
    Shape(
        name="left bumper", law=lambda m, x, v, a: m.maximum(-x - a, 0.0), code="m.maximum(-x - a, 0.0)",
        text="min(x + {a}, 0)", words="acts beyond {a} on the left only: a bumper on one side; {c}",
        opposite="lets go beyond {a} on the left only; {c}", widths=_ANGLES, unit="N*m/rad",
    ),
    Shape(
        name="fifth power", law=lambda m, x, v, a: -x**5, code="-x**5", text="x⁵",
        words="hardens at wide tilts only, like x⁵: rubber that is pressed flat; {c}",
        opposite="softens at wide tilts only, like x⁵; {c}", unit="N*m/rad^5",
    ),
    Shape(
        name="cubic", law=lambda m, x, v, a: -x**3, code="-x**3", text="x³", words="hardens like x³; {c}",
        opposite="softens like x³; {c}", unit="N*m/rad^3",
    ),
    Shape(
        name="square", law=lambda m, x, v, a: -x * m.abs(x), code="-x * m.abs(x)", text="x|x|",
        words="hardens in proportion to the tilt, like x|x|; {c}", opposite="softens in proportion to the tilt; {c}",
        unit="N*m/rad^2",
    ),
    Shape(
        name="lopsided square", law=lambda m, x, v, a: -(x**2), code="-(x**2)", text="x²",
        words="is stiffer the farther to one side, like x²; {c}", unit="N*m/rad^2",
    ),
    Shape(
        name="lopsided", law=lambda m, x, v, a: -m.abs(x), code="-m.abs(x)", text="|x|",
        words="is a spring stiffer on one side, like |x|; {c}", unit="N*m/rad",
    ),
    Shape(
        name="one-way damper", law=lambda m, x, v, a: -m.abs(v), code="-m.abs(v)", text="|v|",
        words="damps in one direction more than in the other, like max(v, 0): a one-way damper; {c}", unit="N*m*s/rad",
    ),
    Shape(
        name="root of the rate", law=lambda m, x, v, a: -v / (m.abs(v) + 1e-6) ** 0.5, code="-v / (m.abs(v) + 1e-6) ** 0.5",
        text="sgn v √|v|", words="brakes like the root of the rate: a seal, or a thin film; {c}", unit="N*m*s^0.5/rad^0.5",
    ),
    Shape(
        name="dry friction", law=lambda m, x, v, a: -v / (m.abs(v) + 1e-3), code="-v / (m.abs(v) + 1e-3)", text="sgn v",
        words="brakes alike at all rates: dry friction; {c}", unit="N*m",
    ),
    Shape(
        name="quadratic drag", law=lambda m, x, v, a: -v * m.abs(v), code="-v * m.abs(v)", text="v|v|",
        words="brakes like v|v|: drag of air or oil; {c}", unit="N*m*s^2/rad^2",
    ),
    Shape(
        name="cubic drag", law=lambda m, x, v, a: -v**3, code="-v**3", text="v³", words="brakes like v³; {c}", unit="N*m*s^3/rad^3",
    ),
    Shape(
        name="damping by the tilt", law=lambda m, x, v, a: -m.abs(x) * v, code="-m.abs(x) * v", text="|x| v",
        words="damps more the wider the tilt, like |x| v; {c}", opposite="damps less the wider the tilt; {c}", unit="N*m*s/rad^2",
    ),
    Shape(
        name="damping by the tilt squared", law=lambda m, x, v, a: -x * x * v, code="-x * x * v", text="x² v",
        words="damps more the wider the tilt, like x² v: rubber that is pressed, or a linkage; {c}",
        opposite="damps less the wider the tilt, like x² v; {c}", unit="N*m*s/rad^3",
    ),
    Shape(
        name="damping on one side", law=lambda m, x, v, a: -x * v, code="-x * v", text="x v",
        words="damps more on one side, like x v; {c}", unit="N*m*s/rad^2",
    ),
    Shape(
        name="drag to one side", law=lambda m, x, v, a: -v * v, code="-v * v", text="v²",
        words="pushes to one side when it is fast, like v²; {c}", unit="N*m*s^2/rad^2",
    ),
)  # fmt: skip


def _shape(name: str) -> Shape:
    return next(shape for shape in SHAPES if shape.name == name)


@dataclass(frozen=True, slots=True, kw_only=True)
class Formula:
    """The formula nearest to a learned torque."""

    shapes: tuple[Shape, ...]
    coefficients: tuple[float, ...]
    """In the shapes' units."""
    widths: tuple[float, ...]
    """Their widths, angles or wave lengths [rad]; 0 where one has none."""
    share: float
    """Of what the learned torque explains of the releases, the share that it explains with the width that was tried [1]."""
    error: float
    """Root mean square residual with it in the place of the tables [rad or rad/s]."""
    good: bool
    """Whether it is as good as the tables."""
    text: str
    """In words."""
    slides: bool = False
    """Whether the joint slides: its widths are shown in mm then."""

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

    def compared(self, *, is_rate: bool) -> str:
        """Say whether it is as good as the tables, and its error."""
        how = "is as good" if self.good else "alone is not as good"
        return f"that formula {how}: error {display(is_rate=is_rate, slides=self.slides)(self.error)}"

    def torque(self, tilt: Array, rate: Array) -> Array:
        """Return the torque [N*m] at tilts [rad] and rates [rad/s], shape (n,) each."""
        m = NUMPY
        terms = zip(self.shapes, self.coefficients, self.widths, strict=True)
        return sum((c * shape.law(m, tilt, rate, width) for shape, c, width in terms), 0.0 * tilt)

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects of the catalogue whose law it is; empty where one of its terms is in none."""
        laws = {
            part.formula.split("} ")[-1].replace("φ̇", "v").replace("φ", "x"): n
            for n, part in catalogue().items()
        }
        names = tuple(laws.get(shape.text, "") for shape in self.shapes)
        return names if all(names) else ()

    @property
    def is_known(self) -> bool:
        """Whether the catalogue has its law: by its terms, or as a stop, on one side or alike on both."""
        bumpers = [
            w for shape, w in zip(self.shapes, self.widths, strict=True) if shape.name.endswith("bumper")
        ]
        if len(bumpers) == len(self.shapes):
            return max(bumpers) < SAME_STOP_RATIO * min(bumpers)
        return bool(self.effects)


def own_effect(formula: Formula) -> tuple[str, str]:
    """Return name and Python source of an effect whose law a formula is, in the language of a user's own file."""
    name = re.sub("[^a-z]+", "-", " and ".join(shape.name for shape in formula.shapes))
    terms: list[str] = []
    parameters: list[tuple[str, str, str, float]] = []
    for i, (shape, c, width) in enumerate(
        zip(formula.shapes, formula.coefficients, formula.widths, strict=True), start=1
    ):
        code = re.sub(r"\ba\b", f'parameters["width_{i}"]', shape.code)
        terms.append(f'parameters["coefficient_{i}"] * ({code})')
        parameters.append((f"coefficient_{i}", shape.unit, f"{abs(c):.3g}", c))
        if shape.widths:
            parameters.append((f"width_{i}", "rad", f"{width:.3g}", width))
    source = effect_file(
        name, title=formula.text.split(":")[-1].split(";")[0].strip() or name, does=f"It {formula.text.split(';')[0]}.",
        law=" + ".join(terms), text=f"τ ∝ -{' - '.join(formula.terms)}", source="read off a learned torque", parameters=parameters,
    )  # fmt: skip
    return name, source


def formula_of(fit: JointFit, *, slides: bool = False) -> Formula | None:
    """Return the formula nearest to what a fit has learned; None where nothing was learned of tilt and rate.

    The shapes that come nearest to the tables are fitted to the releases in their place; the best one is taken.
    """
    if not tables_of(fit) or set(fit.problem.smoothing) == {ZERO_TABLE_WEIGHT}:
        return None
    x, v = motion_of(fit)
    torque, _ = learned_torque(fit, x, v)
    if np.abs(torque).max() < 1e-6 * fit.law.stiffness * np.abs(x).max():
        return None
    plain = np.column_stack([x, v])
    columns, known = _by_information(fit)
    found = [_fitted(fit, chosen, (x, v, torque)) for chosen in _candidates(columns, known)]
    # A parameter must pay for itself, as everywhere: BIC's price.
    best = min(found, key=lambda item: 2 * item[1].normal.cost + len(item[2].names) * np.log(item[2].samples))
    chosen, minimum, problem = best
    values = problem.parameters(minimum.point)
    coefficients = [values[f"{_NAME}.coefficient_{i}"] for i in range(len(chosen))]
    widths = [values[f"{_NAME}.width_{i}"] for i in range(len(chosen))]
    here = [
        c * _without(plain, np.asarray(shape.law(NUMPY, x, v, width)))
        for (shape, _, _), c, width in zip(chosen, coefficients, widths, strict=True)
    ]
    parts = [
        _said(shape, c, width, float(np.quantile(np.abs(column), 0.999)), slides=slides)
        for (shape, _, _), c, width, column in zip(chosen, coefficients, widths, here, strict=True)
    ]
    share = 1 - _rest(chosen, known) / float(known @ known)
    return Formula(
        shapes=tuple(shape for shape, _, _ in chosen),
        coefficients=tuple(coefficients),
        widths=tuple(widths),
        share=share,
        error=rms(problem.residuals(minimum.point)),
        good=spread(problem, minimum) <= MAX_ERROR_RATIO * spread(fit.problem, fit.minimum),
        text=in_words(parts, share),
        slides=slides,
    )


def in_words(parts: Sequence[str], share: float) -> str:
    """Return what goes on after 'it': what the terms of the nearest formula do, and how much of what was learned that is [1]."""
    carries = f"carries {100 * share:.0f} % of what was learned"
    if share > MIN_SHARE:
        return f"{' and '.join(parts)}; this formula {carries}"
    return f"is like no formula that is known here: the nearest {carries}"


_Column = tuple[Shape, float, Array]
"""A shape, its width [rad], and its table in coordinates of what the releases tell apart, shape (p,)."""
_NAME = "formula"


def spread(problem: Problem, minimum: Minimum) -> float:
    """Return the noise that a fit's residuals speak of, for the directions that it took out of them [rad or rad/s]."""
    taken = directions(problem, minimum)
    return rms(problem.residuals(minimum.point)) / float(np.sqrt(max(1 - taken / problem.samples, 0.1)))


def _by_information(fit: JointFit) -> tuple[list[_Column], Array]:
    """Return the shapes as tables, and what was learned, in coordinates in which a distance is what the releases tell apart.

    The normal equations of the fit say how much worse any other table would be: δᵀ H δ. Everything else of the joint is free.
    """
    problem, (part, *_) = fit.problem, tables_of(fit)
    shared, sizes = len(problem.names), problem.sizes()
    hessian = fit.minimum.normal.hessian.copy()
    hessian[:shared, :shared] -= problem.prior
    parameters = part.named(dict(fit.law.effects)[part.name])
    assert part.smoothness is not None
    names = part.smoothness().names
    mine = np.array([problem.names.index(f"{part.name}.{name}") for name in names])
    others = np.setdiff1d(np.arange(len(sizes)), mine)
    mixed = hessian[np.ix_(mine, others)]
    inner = (
        hessian[np.ix_(mine, mine)]
        - mixed @ np.linalg.pinv(hessian[np.ix_(others, others)], hermitian=True) @ mixed.T
    )
    values, vectors = np.linalg.eigh(inner)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T / sizes[mine]
    reach = max(abs(parameters[name]) for name in part.support[:2])
    columns: list[_Column] = []
    for shape in SHAPES:
        for width in shape.widths or (0.0,):
            at = width * reach or 1.0
            table = tabulated(
                lambda x, v, shape=shape, at=at: shape.law(NUMPY, x, v, at) + 0.0 * x, parameters
            )
            column = root @ table
            if float(column @ column) > 1e-12:
                columns.append((shape, width * reach, column))
    return columns, root @ np.array([parameters[name] for name in names])


def _candidates(columns: Sequence[_Column], left: Array) -> list[tuple[_Column, ...]]:
    """Return the shapes that come nearest, each at its best width, and the nearest two bumpers."""
    best: dict[str, tuple[float, _Column]] = {}
    for column in columns:
        rest = _rest([column], left)
        if column[0].name not in best or rest < best[column[0].name][0]:
            best[column[0].name] = rest, column
    nearest = sorted(best.values(), key=lambda item: item[0])
    singles = [(column,) for _, column in nearest[:CANDIDATES]]
    stops = [column for column in columns if column[0].name.endswith("bumper")]
    pairs = [pair for pair in itertools.combinations(stops[::2], 2) if pair[0][0] is not pair[1][0]]
    # There is none where the joint swung to one side only.
    near = sorted(pairs, key=lambda pair: _rest(pair, left))[:1]
    return [*singles, *(two for two in near if _rest(two, left) < 0.5 * nearest[0][0])]


def _fitted(
    fit: JointFit, chosen: tuple[_Column, ...], along: tuple[Array, Array, Array]
) -> tuple[tuple[_Column, ...], Minimum, Problem]:
    """Fit the formula to the releases in the place of the tables."""
    held = {
        f"{_NAME}.width_{i}": width or 1.0 for i, (shape, width, _) in enumerate(chosen) if not shape.widths
    }
    x, v, torque = along
    laws = [np.asarray(shape.law(NUMPY, x, v, width or 1.0)) for shape, width, _ in chosen]
    stiffer, damped, *guess = np.linalg.lstsq(np.column_stack([-x, -v, *laws]), torque, rcond=None)[0]
    start = {**fit.law.parameters}
    start["stiffness"] += stiffer
    start["damping"] += damped
    for i, ((_, width, _), coefficient) in enumerate(zip(chosen, guess, strict=True)):
        start |= {f"{_NAME}.coefficient_{i}": float(coefficient), f"{_NAME}.width_{i}": width or 1.0}
    part = effect_of([shape for shape, _, _ in chosen])
    problem, minimum = fit_instead(fit.problem, fit.minimum.point, part, start, held)
    return chosen, minimum, problem


def effect_of(shapes: Sequence[Shape]) -> TorqueEffect:
    """Return an effect whose torque is a sum of shapes, with a coefficient and a width each."""

    def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
        terms = [
            parameters[f"coefficient_{i}"] * shape.law(m, motion.tilt, motion.rate, parameters[f"width_{i}"])
            for i, shape in enumerate(shapes)
        ]
        return sum(terms[1:], terms[0])

    def size(shape: Shape) -> Callable[[Scales], float]:
        return lambda s: (
            0.1
            * s.torque
            / max(
                abs(float(shape.law(NUMPY, side * s.amplitude, s.rate, 0.3 * s.amplitude)))
                for side in (-1, 1)
            )
        )

    parameters: list[Parameter] = []
    for i, shape in enumerate(shapes):
        parameters += [
            Parameter(name=f"coefficient_{i}", unit=shape.unit, size=size(shape), low=-1e3, high=1e3),
            Parameter(
                name=f"width_{i}", unit="rad", size=lambda s: s.amplitude, low=0.005, high=3.0, neutral=None
            ),
        ]
    return unlisted(_NAME, torque, parameters)


def _rest(columns: Sequence[tuple[Shape, float, Array]], left: Array) -> float:
    """Return the sum of squares that some columns leave."""
    table = np.column_stack([column for _, _, column in columns])
    square = table.T @ table
    size = np.sqrt(np.diag(square))
    if np.linalg.cond(square / np.outer(size, size)) > 1e4:  # two terms that cancel say nothing
        return float("inf")
    along = table.T @ left
    return max(float(left @ left - along @ np.linalg.solve(square, along)), 0.0)


def _without(plain: Array, column: Array) -> Array:
    """Take out of a torque what spring and damper can do."""
    return column - plain @ np.linalg.lstsq(plain, column, rcond=None)[0]


def motion_of(fit: JointFit) -> tuple[Array, Array]:
    """Return tilt [rad] and rate [rad/s] along the fitted releases, shape (n,) each."""
    law = fit.law.of_joint()
    tilts: list[Array] = []
    rates: list[Array] = []
    for record, (roll, rate) in zip(fit.records, fit.starts, strict=True):
        path = simulate(law, np.linspace(0.0, float(record.time[-1]), 1500), roll, rate)
        tilts.append(path.roll - law.rest_angle)
        rates.append(path.rate)
    return np.concatenate(tilts), np.concatenate(rates)


def _said(shape: Shape, coefficient: float, width: float, torque: float, *, slides: bool) -> str:
    words = shape.opposite if coefficient < 0 and shape.opposite else shape.words
    show = display(is_rate=False, slides=slides)
    return words.format(a=show(width, 3), a2=show(2 * width, 3), c=f"{torque:.2g} {'N' if slides else 'N·m'}")
