"""Torques that no effect of the catalogue makes, as candidates: where one of them is the better law, nothing is named.

What is outside the catalogue can often be mimicked by effects that are inside. A law of another shape that predicts
better shows that the mimicry is one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.diagnosis.search import COARSE, Candidate, Search, completed, inherited
from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, Parameter, Scales, TorqueEffect
from sysid.effects._unlisted import CLOCK, from_zero, unlisted
from sysid.fitting.problem import Problem
from sysid.joint.structure import Structure
from sysid.least_squares import Minimum
from sysid.roll import Array

Shape = Callable[[Algebra, Value, Value, Value], Value]
"""Of the algebra, tilt and rate over their largest, and time over the longest release."""


def _wave(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    return parameters["strength"] * m.sin(parameters["frequency"] * states[0])


WAVE = unlisted(
    "surrogate", _wave,
    (
        Parameter(name="strength", unit="N*m", size=lambda s: 0.1 * s.torque, low=0.0, high=30.0),
        Parameter(name="frequency", unit="rad/s", size=lambda s: s.frequency, low=0.05, high=8.0, neutral=None),
    ),
    (CLOCK,),
)  # fmt: skip
"""A torque that follows a clock of its own, which each release may meet at any time."""
_STIFFNESS = from_zero("stiffness", lambda s: 0.3 * s.stiffness, 0.0)
_DAMPING = from_zero("damping", lambda s: 0.3 * s.stiffness / s.frequency, 0.0)
CHANGED = (
    unlisted("surrogate", lambda m, motion, parameters, states: -states[0] * motion.tilt, (), (_STIFFNESS,)),
    unlisted(
        "surrogate", lambda m, motion, parameters, states: -states[0] * motion.tilt - states[1] * motion.rate,
        (), (_STIFFNESS, _DAMPING),
    ),
)  # fmt: skip
"""Another spring, and another damper, in each release: they stay from its beginning to its end."""


@dataclass(frozen=True, slots=True)
class Law:
    """A torque that no effect of the catalogue makes."""

    words: str
    terms: tuple[Shape, ...] = ()
    """With a strength each, which all releases share."""
    own: TorqueEffect | None = None
    """In the place of terms: an effect whose states begin anew with each release."""

    @property
    def changes(self) -> bool:
        """Whether it is another one later, or in another release."""
        return len(self.terms) > 1 or self.own in CHANGED


TRIED = 2
"""Shapes of a place that are predicted: on the coarse grid the best one may not have come to its best."""
CREEP = 1e-3
"""Share of the largest rate below which a root of the rate is a damper: its slope has no end there."""
LAWS: dict[str, Law] = {
    "x⁵": Law("a spring that hardens at wide tilts only, like x⁵", (lambda m, x, v, t: x**5,)),
    "x|x|": Law("a spring that hardens in proportion to the tilt, like x|x|", (lambda m, x, v, t: x * m.abs(x),)),
    "√v": Law("friction that grows like the root of the rate", (lambda m, x, v, t: v * (m.abs(v) + CREEP) ** -0.5,)),
    "v²": Law("a drag that pushes to one side, like v²", (lambda m, x, v, t: v * v,)),
    "|v|": Law("a damper that is stronger in one direction, like |v|", (lambda m, x, v, t: m.abs(v),)),
    "x v": Law("a damper that is stronger on one side, like x v", (lambda m, x, v, t: x * v,)),
    "|x| v": Law("damping that grows with the tilt, like |x| v", (lambda m, x, v, t: m.abs(x) * v,)),
    "x² v": Law("damping that grows with the square of the tilt, like x² v", (lambda m, x, v, t: x * x * v,)),
    # What changes need not do so at a constant rate.
    "t x": Law(
        "a spring that changes during a release",
        (lambda m, x, v, t: t * x, lambda m, x, v, t: t * t * x, lambda m, x, v, t: t**3 * x),
    ),
    "t v": Law(
        "a damper that changes during a release",
        (lambda m, x, v, t: t * v, lambda m, x, v, t: t * t * v, lambda m, x, v, t: t**3 * v),
    ),
    "k": Law("a spring that changed between the releases", own=CHANGED[0]),
    "k d": Law("a spring and a damper that changed between the releases", own=CHANGED[1]),
    "sin t": Law("a torque that comes and goes at a frequency of its own, whatever the joint does", own=WAVE),
}  # fmt: skip


def surrogate(search: Search, model: Candidate, kept: tuple[str, ...], shape: str) -> Candidate:
    """Fit a torque of one shape in the place of a model's other effects.

    Args:
        search: That found the model.
        model: A fitted candidate.
        kept: Its effects that stay.
        shape: One of `LAWS`.
    """
    inside, scales = search.problem(kept, free_states=model.problem.free_states), search.scales
    own = LAWS[shape].own
    structure = Structure(inside.structure.effects, (own or _sum_of(LAWS[shape].terms, scales),))
    replaced = {"stiffness": scales.stiffness, "damping": scales.damping}
    held = {s.name: replaced[s.name] for s in own.states} if own in CHANGED else {}
    problem = Problem(
        structure, search.records, scales, bias=search.bias, fixed={**held, **inside.fixed}, average=search.average,
        free_states=own is not None or (model.problem.free_states and bool(inside.structure.internal_states)),
        steps_per_period=int(COARSE * min(1.5, structure.sharpness)),
    )  # fmt: skip
    starts = _starts(problem, model)
    if own is WAVE:
        before = _best(inside, _starts(inside, model))
        starts = [_in_step(problem, replace(model, problem=inside, minimum=before))]
    return Candidate(effects=kept, problem=problem, minimum=_best(problem, starts), shape=shape)


def _starts(problem: Problem, model: Candidate) -> list[Array]:
    """Return starts of a problem at a model's parameters, and at those of a linear decay."""
    scales = problem.scales
    linear = {**model.parameters, "stiffness": scales.stiffness, "damping": scales.damping}
    plain = {**dict.fromkeys(problem.names, 0.0), **completed(problem, linear)}
    return [inherited(problem, model), problem.start(plain)]


def _best(problem: Problem, starts: Sequence[Array]) -> Minimum:
    return min((problem.fitted(start, 20) for start in starts), key=lambda m: m.normal.cost)


def _in_step(problem: Problem, before: Candidate) -> Array:
    """Return a start whose wave has the frequency, height and phase that a joint without it misses most.

    Args:
        problem: With the wave, whose clock is the last of each release's internal states.
        before: Fitted without it.
    """
    start = inherited(problem, before)
    if not np.isfinite(before.cost):
        return start
    inside, scales, average = before.problem, problem.scales, problem.average
    missed = [
        (residual, np.linalg.qr(jacobian)[0], record.time[: average * len(residual)].reshape(-1, average).mean(1))
        for record, (residual, jacobian) in zip(inside.records, inside.linearise(before.minimum.point), strict=True)
    ]  # fmt: skip

    def response(frequency: float) -> tuple[float, Array]:
        """Return the squares that a wave takes away, and what it is in each release, a + ib for a cos + b sin."""
        taken, waves = 0.0, list[complex]()
        for residual, basis, time in missed:
            swing = np.column_stack([np.cos(frequency * time), np.sin(frequency * time)])
            swing -= basis @ (basis.T @ swing)
            along = np.linalg.lstsq(swing, residual, rcond=1e-3)[0]
            taken += float(residual @ swing @ along)
            waves.append(complex(*along))
        return taken, np.array(waves)

    grid = np.arange(0.1 * scales.frequency, 5.0 * scales.frequency, 1.0 / scales.duration)
    frequency = max(grid, key=lambda f: response(f)[0])
    stiffness = scales.stiffness - scales.inertia * frequency**2 + 1j * frequency * scales.damping
    driven = (
        -np.conj(response(frequency)[1]) * stiffness / (1j * frequency if inside.records[0].is_rate else 1)
    )
    sizes = problem.sizes()
    for name, value in (("strength", float(np.abs(driven).mean())), ("frequency", frequency)):
        where = problem.names.index(f"surrogate.{name}")
        start[where] = value / sizes[where]
    problem.own(start)[:, 1 + len(problem.structure.internal_states)] = (
        (np.angle(driven) + np.pi / 2) / frequency / scales.duration
    )
    return start


def surrogates(search: Search, model: Candidate) -> list[Candidate]:
    """Return the best shapes in each of a model's effects' places and in all of them, predicted.

    In one release alone the amplitude only falls, so a law that changes with time can be any law that changes with amplitude:
    it says nothing there.

    In this process: laws that are no module's do not travel to another.
    """
    named = search.added(model)
    shapes = [shape for shape, law in LAWS.items() if len(search.records) > 1 or not law.changes]
    best: list[Candidate] = []
    for place in dict.fromkeys([named, *((name,) for name in named)]):
        kept = tuple(n for n in model.effects if n not in place)
        tried = [surrogate(search, model, kept, shape) for shape in shapes]
        best += sorted(tried, key=lambda m: m.cost + np.log(m.samples) * m.size)[:TRIED]
        if search.progress is not None:
            search.progress("laws outside the catalogue", 0.97)
    return [search.finalist(m) for m in best]


def in_words(model: Candidate) -> str:
    """Return what the law of a surrogate is, with the sizes of what no shape tells."""
    law, problem = LAWS[model.shape], model.problem
    if law.own is WAVE:
        return f"{law.words}, {model.parameters['surrogate.frequency'] / (2 * np.pi):.3g} times a second"
    if law.own in CHANGED:
        first = len(problem.structure.internal_states) - len(law.own.states)
        springs = (
            problem.own(model.minimum.point * problem.sizes())[:, 2 + first] + problem.fixed["stiffness"]
        )
        shares = ", ".join(f"{k:.3f}" for k in springs / springs.mean())
        return f"{law.words} (its stiffness in each, over their mean: {shares})"
    return law.words


def _sum_of(terms: Sequence[Shape], scales: Scales) -> TorqueEffect:
    def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
        x, v = motion.tilt / scales.amplitude, motion.rate / scales.rate
        t = states[0] / scales.duration if states else 0.0
        parts = [parameters[f"strength_{i}"] * shape(m, x, v, t) for i, shape in enumerate(terms)]
        return -sum(parts[1:], parts[0])

    strengths = [
        Parameter(name=f"strength_{i}", unit="N*m", size=lambda s: 0.3 * s.torque, low=-10.0, high=10.0, starts=(0.0,))
        for i in range(len(terms))
    ]  # fmt: skip
    return unlisted("surrogate", torque, strengths, (CLOCK,) if len(terms) > 1 else ())
