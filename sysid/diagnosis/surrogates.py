"""Torques that no effect of the catalogue makes, as candidates: where one of them is the better law, nothing is named.

What is outside the catalogue can often be mimicked by effects that are inside. A law of another shape that predicts
better shows that the mimicry is one.
"""

from collections.abc import Sequence

from sysid.diagnosis.search import COARSE, FINE, Candidate, Search, inherited
from sysid.effects.base import (
    Algebra,
    Effect,
    Motion,
    MujocoSupport,
    Parameter,
    State,
    Value,
    Values,
    belongs_to_log,
)
from sysid.fit_problem import Problem
from sysid.joint_flow import Structure
from sysid.least_squares import minimise
from sysid.score_test import SHAPES, Shape

WORDS: dict[str, str] = {
    "x⁵": "a spring that hardens at wide tilts only, like x⁵",
    "x|x|": "a spring that hardens in proportion to the tilt, like x|x|",
    "v²": "a drag that pushes to one side, like v²",
    "|v|": "a damper that is stronger in one direction, like |v|",
    "x v": "a damper that is stronger on one side, like x v",
    "|x| v": "damping that grows with the tilt, like |x| v",
    "x² v": "damping that grows with the square of the tilt, like x² v",
    "t x": "a spring that changes during a release",
    "t v": "a damper that changes during a release",
}
"""Shapes that no effect of the catalogue has, in words."""
CHANGES: dict[str, Sequence[Shape]] = {
    "t x": (lambda m, x, v, t: t * t * x, lambda m, x, v, t: t**3 * x),
    "t v": (lambda m, x, v, t: t * t * v, lambda m, x, v, t: t**3 * v),
}
"""What changes need not do so at a constant rate: further terms."""


def surrogate(search: Search, model: Candidate, kept: tuple[str, ...], shape: str) -> Candidate:
    """Fit a torque of one shape in the place of a model's other effects.

    Args:
        search: That found the model.
        model: A fitted candidate.
        kept: Its effects that stay.
        shape: One of `WORDS`.
    """
    inside = search.problem(kept, free_states=model.problem.free_states)
    structure = Structure(inside.structure.effects, (_effect(shape),))
    free = model.problem.free_states and bool(inside.structure.memories)
    fixed = {
        **inside.fixed, "surrogate.amplitude": search.scales.amplitude, "surrogate.speed": search.scales.rate,
        "surrogate.duration": search.scales.duration,
    }  # fmt: skip
    problem = Problem(
        structure, search.records, search.scales, bias=search.bias, fixed=fixed, free_states=free, average=search.average,
        steps_per_period=int(COARSE * min(1.5, structure.sharpness)),
    )  # fmt: skip
    linear = {"stiffness": search.scales.stiffness, "damping": search.scales.damping}
    starts = [inherited(problem, model), problem.start({**dict.fromkeys(problem.names, 0.0), **model.parameters, **linear})]
    found = [minimise(problem.normal, p, *problem.bounds(), iterations=20, tolerance=1e-5) for p in starts]
    best = min(found, key=lambda m: m.normal.cost)
    return Candidate(effects=kept, problem=problem, minimum=best, shape=shape)


def surrogates(search: Search, model: Candidate, share: float) -> list[Candidate]:
    """Return the best shape in each of a model's effects' places, in all of them, and beside all of them; predicted."""
    named = tuple(n for n in model.effects if n not in search.base)
    places = dict.fromkeys([named, (), *((name,) for name in named)])
    best: list[Candidate] = []
    for place in places:
        kept = tuple(n for n in model.effects if n not in place)
        jobs = [(model, kept, shape) for shape in WORDS]
        tried = search.each("laws outside the catalogue", surrogate, jobs, share, share)
        best.append(min(tried, key=lambda m: m.cost))
    return search.each("laws outside the catalogue", Search.finalist, [(m, ()) for m in best], share, share)


def _effect(name: str) -> Effect:
    terms = (SHAPES[name], *CHANGES.get(name, ()))

    def torque(m: Algebra, motion: Motion, parameters: Values, states: Sequence[Value]) -> Value:
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
    return Effect(
        name="surrogate", title=WORDS[name], family="hardening", parameters=(*strengths, *sizes), law=name, source="",
        does="", look_alikes=(), experiment="", mujoco=MujocoSupport(means="", since="", warp=False),
        to_mjcf=belongs_to_log, example=(), torque=torque, states=(clock,) if name in CHANGES else (),
    )  # fmt: skip
