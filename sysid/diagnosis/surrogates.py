"""Torques that no effect of the catalogue makes, as candidates: where one of them is the better law, nothing is named.

What is outside the catalogue can often be mimicked by effects that are inside. A law of another shape that predicts
better shows that the mimicry is one.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import numpy.typing as npt

from sysid.diagnosis.search import COARSE, Candidate, Search, completed, inherited, take_motion
from sysid.effects._algebra import NUMPY, Algebra, Value, Values
from sysid.effects._base import JointState, Parameter, Scales, TorqueEffect
from sysid.effects._unlisted import CLOCK, from_zero, unlisted
from sysid.errors import SysidError
from sysid.fitting.formula import SHAPES, Shape, effect_of
from sysid.fitting.problem import Problem
from sysid.joint import JointLaw, simulate
from sysid.joint.structure import Structure
from sysid.joint.torques import effect_torque
from sysid.least_squares import Minimum
from sysid.roll import Array
from sysid.text import display

Term = Callable[[Algebra, Value, Value, Value], Value]
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
_REST = from_zero("rest_angle", lambda s: 0.1 * s.amplitude, 0.0)
CHANGED = (
    unlisted("surrogate", lambda m, motion, parameters, states: -states[0] * motion.tilt, (), (_STIFFNESS,)),
    unlisted(
        "surrogate", lambda m, motion, parameters, states: -states[0] * motion.tilt - states[1] * motion.rate,
        (), (_STIFFNESS, _DAMPING),
    ),
    unlisted("surrogate", lambda m, motion, parameters, states: motion.stiffness * states[0], (), (_REST,)),
)  # fmt: skip
"""Another spring, another damper, or another rest in each release: they stay from its beginning to its end."""


@dataclass(frozen=True, slots=True)
class Law:
    """A torque that no effect of the catalogue makes."""

    words: str
    terms: tuple[Term, ...] = ()
    """With a strength each, which all releases share."""
    own: TorqueEffect | None = None
    """In the place of terms: an effect whose states begin anew with each release."""
    shapes: tuple[Shape, ...] = ()
    """In the place of both: formulas with a width of their own, as a learned torque is read."""

    @property
    def changes(self) -> bool:
        """Whether it is another one later, or in another release."""
        return len(self.terms) > 1 or self.own in CHANGED


def _named(*names: str) -> tuple[Shape, ...]:
    return tuple(next(shape for shape in SHAPES if shape.name == name) for name in names)


TRIED = 2
"""Shapes of a place that are predicted: on the coarse grid the best one may not have come to its best."""
POINTS = 200
"""Points a period at which the torques of two laws are compared; one that jumps at a kink needs many: a choice."""
SHARP = 2.0
"""Factor of the steps a period of shapes that bend within a part of the swing, as of a stop [1]. Bumpers 2.7 times as stiff as the spring,
read to 1e-4 rad, are left 5 % more than the noise with 1, 3 % with 1.5, and as little with 2 as with 4 and 8; magnets and cogs less."""
CREEP = 1e-3
"""Share of the largest rate below which a root of the rate is a damper: its slope has no end there."""
AT_ONCE = 64
"""Frequencies that are asked together: a few megabytes of waves."""
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
    "rest": Law("a rest that moved between the releases, as of a sensor or a mount that was knocked", own=CHANGED[2]),
    "sin t": Law("a torque that comes and goes at a frequency of its own, whatever the joint does", own=WAVE),
    "magnet": Law("a magnet or a detent, or what pushes out of the middle", shapes=_named("magnet")),
    "tails": Law("a magnet with wide tails, or what pushes out of the middle", shapes=_named("magnet with wide tails")),
    "cogs": Law("a torque that comes in waves along the tilt, as of teeth or poles of a motor", shapes=_named("cogging")),
    "bumpers": Law("bumpers that begin at other tilts to either side", shapes=_named("right bumper", "left bumper")),
}  # fmt: skip


def surrogate(
    search: Search, model: Candidate, kept: tuple[str, ...], shape: str, best: Candidate | None = None
) -> Candidate:
    """Fit a torque of one shape in the place of a model's other effects.

    Args:
        search: That found the model.
        model: A fitted candidate.
        kept: Its effects that stay.
        shape: One of `LAWS`.
        best: Another, whose torque a shape with a width may begin as, too.
    """
    job = (search, model, kept, shape)
    return Candidate(effects=kept, problem=_problem(*job), minimum=_fitted(*job, best), shape=shape)


@cache
def _effect(shape: str, scales: Scales) -> TorqueEffect:
    """Return the effect that a shape is: one and the same, so that what is built for it is built once."""
    law = LAWS[shape]
    if law.shapes:
        return replace(effect_of(law.shapes), sharpness=SHARP)
    return law.own or _sum_of(law.terms, scales)


def _problem(search: Search, model: Candidate, kept: tuple[str, ...], shape: str) -> Problem:
    """Return the least squares of `surrogate`."""
    inside, scales = search.problem(kept, free_states=model.problem.free_states), search.scales
    own = LAWS[shape].own
    structure = Structure(inside.structure.effects, (_effect(shape, scales),))
    replaced = {"stiffness": scales.stiffness, "damping": scales.damping, "rest_angle": 0.0}
    held = {s.name: replaced[s.name] for s in own.states} if own in CHANGED else {}
    return Problem(
        structure, search.records, scales, bias=search.bias, fixed={**held, **inside.fixed}, priors=inside.priors, average=search.average,
        free_states=own is not None or (model.problem.free_states and bool(inside.structure.internal_states)),
        steps_per_period=int(COARSE * min(1.5, structure.sharpness)),
    )  # fmt: skip


def _fitted(
    search: Search, model: Candidate, kept: tuple[str, ...], shape: str, best: Candidate | None
) -> Minimum:
    """Return where the fit of `surrogate` ends: what travels from another process, which a law that is no module's does not."""
    law, problem = LAWS[shape], _problem(search, model, kept, shape)
    starts = _starts(problem, model)
    if law.shapes:
        others = () if best is None or best is model else (best,)
        likes = [one for one in (model, *others) if set(kept) <= set(one.effects)]
        starts = [start for one in likes for start in _starts_as(problem, one, kept, law.shapes)] or starts
    if law.own is WAVE:
        inside = search.problem(kept, free_states=model.problem.free_states)
        before = _best(inside, _starts(inside, model))
        starts = [_in_step(problem, replace(model, problem=inside, minimum=before))]
    return _best(problem, starts)


def _starts(problem: Problem, model: Candidate) -> list[Array]:
    """Return starts of a problem at a model's parameters, and at those of a linear decay."""
    scales = problem.scales
    linear = {**model.parameters, "stiffness": scales.stiffness, "damping": scales.damping}
    plain = {**dict.fromkeys(problem.names, 0.0), **completed(problem, linear)}
    return [inherited(problem, model), problem.start(plain)]


def _best(problem: Problem, starts: Sequence[Array]) -> Minimum:
    return min((problem.fitted(start, 20) for start in starts), key=lambda m: m.normal.cost)


def _starts_as(
    problem: Problem, like: Candidate, kept: tuple[str, ...], shapes: Sequence[Shape]
) -> list[Array]:
    """Return a start whose shapes do most of what a model's other effects do, along its motion; none where that runs away."""
    try:
        parameters = {**like.parameters, **_alike(like, kept, shapes, problem.structure.parts[-1].name)}
    except SysidError:  # at finer steps than it was fitted with
        return []
    start = problem.start(completed(problem, parameters))
    take_motion(problem, start, like)
    return [start]


def _alike(model: Candidate, kept: tuple[str, ...], shapes: Sequence[Shape], name: str) -> dict[str, float]:
    """Return the parameters with which shapes come nearest to the torque of a model's other effects."""
    problem = model.problem
    law = JointLaw.from_vector(problem.structure, problem.vector_of(model.parameters)).of_joint()
    tilts, rates, torques = list[Array](), list[Array](), list[Array]()
    for record, start in zip(problem.records, problem.starts(model.minimum.point), strict=True):
        time = np.arange(0.0, float(record.time[-1]), 2 * np.pi / problem.scales.frequency / POINTS)
        path = simulate(law, time, *start)
        stays = (effect_torque(law, n, time, path.roll, path.rate) for n, _ in law.effects if n in kept)
        tilts.append(path.roll - law.rest_angle)
        rates.append(path.rate)
        torques.append(law.inertia * np.gradient(path.rate, time) - sum(stays))
    x, v, torque = map(np.concatenate, (tilts, rates, torques))
    plain, reach = [-x, -v, np.ones_like(x)], float(np.abs(x).max())

    def nearest(widths: tuple[float, ...]) -> tuple[float, Array]:
        laws = [np.asarray(s.law(NUMPY, x, v, w * reach)) for s, w in zip(shapes, widths, strict=True)]
        columns = np.column_stack([*plain, *laws])
        found = np.asarray(np.linalg.lstsq(columns, torque)[0], dtype=np.float64)
        return float(np.sum((torque - columns @ found) ** 2)), found

    # Of two shapes every other width: their pairs are many.
    grid = itertools.product(*(shape.widths[:: len(shapes)] for shape in shapes))
    best, (_, found) = min(((widths, nearest(widths)) for widths in grid), key=lambda one: one[1][0])
    parameters = {"stiffness": float(found[0]), "damping": float(found[1])}
    for i, (coefficient, width) in enumerate(zip(found[len(plain) :], best, strict=True)):
        parameters |= {f"{name}.coefficient_{i}": float(coefficient), f"{name}.width_{i}": width * reach}
    return parameters


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

    def response(frequencies: Array) -> tuple[Array, npt.NDArray[np.complex128]]:
        """Return for each frequency the squares that a wave takes away, and what it is in each release, a + ib for a cos + b sin."""
        taken, waves = np.zeros(len(frequencies)), list[npt.NDArray[np.complex128]]()
        for residual, basis, time in missed:
            phase = np.outer(frequencies, time)
            swing = np.stack([np.cos(phase), np.sin(phase)], axis=1)
            swing -= (swing @ basis) @ basis.T
            along = np.linalg.pinv(swing @ swing.transpose(0, 2, 1), rcond=1e-6, hermitian=True)
            along = (along @ (swing @ residual)[:, :, None])[:, :, 0]
            taken += np.sum((swing @ residual) * along, axis=1)
            waves.append(along[:, 0] + 1j * along[:, 1])
        return taken, np.array(waves)

    grid = np.arange(0.1 * scales.frequency, 5.0 * scales.frequency, 1.0 / scales.duration)
    taken = np.concatenate([response(some)[0] for some in np.array_split(grid, -(-len(grid) // AT_ONCE))])
    frequency = float(grid[np.argmax(taken)])
    wave = response(np.array([frequency]))[1][:, 0]
    stiffness = scales.stiffness - scales.inertia * frequency**2 + 1j * frequency * scales.damping
    driven = -np.conj(wave) * stiffness / (1j * frequency if inside.records[0].is_rate else 1)
    sizes = problem.sizes()
    for name, value in (("strength", float(np.abs(driven).mean())), ("frequency", frequency)):
        where = problem.names.index(f"surrogate.{name}")
        start[where] = value / sizes[where]
    problem.own(start)[:, 1 + len(problem.structure.internal_states)] = (
        (np.angle(driven) + np.pi / 2) / frequency / scales.duration
    )
    return start


def surrogates(search: Search, model: Candidate, best: Candidate | None = None) -> list[Candidate]:
    """Return the best shapes in each of a model's effects' places and in all of them, predicted.

    Args:
        search: That found the model.
        model: A fitted candidate.
        best: The one with the least error, which is nearer to what a shape with a width may be.
    """
    if search.progress is not None:
        search.progress("laws outside the catalogue", 0.97)
    named = search.added(model)
    places = dict.fromkeys([named, *((name,) for name in named)])
    tried = _all(search, model, [tuple(n for n in model.effects if n not in place) for place in places], best)
    return [
        search.finalist(m)
        for shapes in tried
        for m in sorted(shapes, key=lambda m: m.cost + np.log(m.samples) * m.size)[:TRIED]
    ]


def nearest_outside(search: Search, model: Candidate) -> Candidate:
    """Return the law outside the catalogue that comes nearest in the place of all of a model's effects."""
    (tried,) = _all(search, model, [search.base], None)
    return search.fine(min(tried, key=lambda m: m.cost))


def _all(
    search: Search, model: Candidate, rests: Sequence[tuple[str, ...]], best: Candidate | None
) -> list[list[Candidate]]:
    """Return every shape beside some of a model's effects, for each of several choices of these, on all workers."""
    jobs = [[(search, model, kept, shape) for shape in _shapes(search)] for kept in rests]
    found = search.pool.each(_fitted, [(*job, best) for some in jobs for job in some])
    return [
        [Candidate(effects=job[2], problem=_problem(*job), minimum=next(found), shape=job[3]) for job in some]
        for some in jobs
    ]


def _shapes(search: Search) -> list[str]:
    """Return the laws that say something of a log.

    In one release alone the amplitude only falls, so a law that changes with time can be any law that changes with amplitude.
    A rest of its own in each release says something only where a spring gives them one, and the sensor's zero is not free in each.
    """
    rests = search.bias == "shared" and not search.records[0].is_rate and not search.hangs
    return [
        shape for shape, law in LAWS.items()
        if (len(search.records) > 1 or not law.changes) and (rests or law.own is not CHANGED[2])
    ]  # fmt: skip


def in_words(model: Candidate, *, slides: bool = False) -> str:
    """Return what the law of a surrogate is, with the sizes of what no shape tells; of a joint that slides, in mm."""
    law, problem = LAWS[model.shape], model.problem
    if law.own is WAVE:
        return f"{law.words}, {model.parameters['surrogate.frequency'] / (2 * np.pi):.3g} times a second"
    if law.shapes:
        show = display(is_rate=False, slides=slides)
        widths = (show(model.parameters[name], 3) for name in model.parameters if ".width_" in name)
        return f"{law.words} ({' and '.join(widths)})"
    if law.own in CHANGED:
        first = len(problem.structure.internal_states) - len(law.own.states)
        own = problem.own(model.minimum.point * problem.sizes())[:, 2 + first]
        if law.own is CHANGED[2]:
            show, digit = display(is_rate=False, slides=slides), float(np.abs(own).max()) / 100
            return f"{law.words} ({', '.join(show(digit * round(rest / digit), 3) for rest in own)})"
        springs = own + problem.fixed["stiffness"]
        shares = ", ".join(f"{k:.3f}" for k in springs / springs.mean())
        return f"{law.words} (its stiffness in each, over their mean: {shares})"
    return law.words


def _sum_of(terms: Sequence[Term], scales: Scales) -> TorqueEffect:
    def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
        x, v = motion.tilt / scales.amplitude, motion.rate / scales.rate
        t = states[0] / scales.duration if states else 0.0
        parts = [parameters[f"strength_{i}"] * term(m, x, v, t) for i, term in enumerate(terms)]
        return -sum(parts[1:], parts[0])

    strengths = [
        Parameter(name=f"strength_{i}", unit="N*m", size=lambda s: 0.3 * s.torque, low=-10.0, high=10.0, starts=(0.0,))
        for i in range(len(terms))
    ]  # fmt: skip
    return unlisted("surrogate", torque, strengths, (CLOCK,) if len(terms) > 1 else ())
