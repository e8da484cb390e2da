"""Torques that no effect of the catalogue makes, as candidates: where one of them is the better law, nothing is named.

What is outside the catalogue can often be mimicked by effects that are inside. A law of another shape that predicts
better shows that the mimicry is one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sysid.diagnosis.search import COARSE, Candidate, Search, completed, inherited
from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, MujocoSupport, Parameter, State, TorqueEffect, belongs_to_log
from sysid.fitting.problem import Problem
from sysid.joint.structure import Structure
from sysid.least_squares import minimise

Shape = Callable[[Algebra, Value, Value, Value], Value]
"""Of the algebra, tilt and rate over their largest, and time over the longest release."""


@dataclass(frozen=True, slots=True)
class Law:
    """A torque that no effect of the catalogue makes."""

    words: str
    terms: tuple[Shape, ...]

    @property
    def changes(self) -> bool:
        """Whether it depends on time."""
        return len(self.terms) > 1


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
}  # fmt: skip


def surrogate(search: Search, model: Candidate, kept: tuple[str, ...], shape: str) -> Candidate:
    """Fit a torque of one shape in the place of a model's other effects.

    Args:
        search: That found the model.
        model: A fitted candidate.
        kept: Its effects that stay.
        shape: One of `LAWS`.
    """
    inside = search.problem(kept, free_states=model.problem.free_states)
    structure = Structure(inside.structure.effects, (_effect(shape),))
    free = model.problem.free_states and bool(inside.structure.internal_states)
    fixed = {
        **inside.fixed, "surrogate.amplitude": search.scales.amplitude, "surrogate.speed": search.scales.rate,
        "surrogate.duration": search.scales.duration,
    }  # fmt: skip
    problem = Problem(
        structure, search.records, search.scales, bias=search.bias, fixed=fixed, free_states=free, average=search.average,
        steps_per_period=int(COARSE * min(1.5, structure.sharpness)),
    )  # fmt: skip
    linear = {"stiffness": search.scales.stiffness, "damping": search.scales.damping}
    starts = [
        inherited(problem, model),
        problem.start(
            {**dict.fromkeys(problem.names, 0.0), **completed(problem, {**model.parameters, **linear})}
        ),
    ]
    found = [minimise(problem.normal, p, *problem.bounds(), iterations=20, tolerance=1e-5) for p in starts]
    best = min(found, key=lambda m: m.normal.cost)
    return Candidate(effects=kept, problem=problem, minimum=best, shape=shape)


def surrogates(search: Search, model: Candidate) -> list[Candidate]:
    """Return the best shape in each of a model's effects' places and in all of them, predicted.

    In one release alone the amplitude only falls, so a law that changes with time can be any law that changes with amplitude:
    it says nothing there.

    In this process: laws that are no module's do not travel to another.
    """
    named = tuple(n for n in model.effects if n not in search.base)
    shapes = [shape for shape, law in LAWS.items() if len(search.records) > 1 or not law.changes]
    best: list[Candidate] = []
    for place in dict.fromkeys([named, *((name,) for name in named)]):
        kept = tuple(n for n in model.effects if n not in place)
        best.append(min((surrogate(search, model, kept, shape) for shape in shapes), key=lambda m: m.cost))
        if search.progress is not None:
            search.progress("laws outside the catalogue", 0.97)
    return [search.finalist(m) for m in best]


def _effect(name: str) -> TorqueEffect:
    terms = LAWS[name].terms

    def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
        x, v = motion.tilt / parameters["amplitude"], motion.rate / parameters["speed"]
        t = states[0] / parameters["duration"] if states else 0.0
        parts = [parameters[f"strength_{i}"] * shape(m, x, v, t) for i, shape in enumerate(terms)]
        return -sum(parts[1:], parts[0])

    clock = State(
        name="time", start=lambda m, tilt, hold, stiffness, parameters: 0.0 * tilt,
        size=lambda s: s.duration, rate=lambda m, motion, z, parameters: 1.0,
    )  # fmt: skip
    strengths = [
        Parameter(name=f"strength_{i}", unit="N*m", size=lambda s: 0.3 * s.torque, low=-10.0, high=10.0, starts=(0.0,))
        for i in range(len(terms))
    ]  # fmt: skip
    sizes = [
        Parameter(name="amplitude", unit="rad", size=lambda s: s.amplitude, low=0.0, high=2.0),
        Parameter(name="speed", unit="rad/s", size=lambda s: s.rate, low=0.0, high=2.0),
        Parameter(name="duration", unit="s", size=lambda s: s.duration, low=0.0, high=2.0),
    ]
    return TorqueEffect(
        name="surrogate", title=LAWS[name].words, family="hardening", parameters=(*strengths, *sizes), law=name, source="",
        does="", look_alikes=(), experiment="", mujoco=MujocoSupport(means="", since="", warp=False),
        to_mjcf=belongs_to_log, example=(), torque=torque, states=(clock,) if LAWS[name].changes else (),
    )  # fmt: skip
