"""Torques that no effect of the catalogue makes, tried in its place: a verdict must beat them.

What is not in the catalogue can often be mimicked by effects that are. A law outside it that says the same with
fewer numbers, or fits better, shows that the mimicry is one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from sysid.diagnosis.score_statistic import SHAPES, Shape
from sysid.diagnosis.search import COARSE, FINE, Model, Searcher, defaults
from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, MujocoSupport, Parameter, State, TorqueEffect, belongs_to_log
from sysid.fitting.problem import Problem
from sysid.joint.structure import Structure
from sysid.least_squares import minimise

UNNAMED: dict[str, str] = {
    "x⁵": "a spring that hardens at wide tilts only, like x⁵",
    "x|x|": "a spring that hardens in proportion to the tilt, like x|x|",
    "|x|": "a spring that is stiffer on one side, like |x|",
    "v²": "a drag that pushes to one side, like v²",
    "|v|": "a damper that is stronger in one direction, like |v|",
    "x v": "a damper that is stronger on one side, like x v",
    "|x| v": "damping that grows with the tilt, like |x| v",
    "x² v": "damping that grows with the square of the tilt, like x² v",
    "t x": "a spring that changes during a release",
    "t v": "a damper that changes during a release",
}
"""Shapes of the score test that no effect of the catalogue has, in words."""
_BENT: dict[str, Sequence[Shape]] = {
    "t x": (lambda m, x, v, t: t * t * x, lambda m, x, v, t: t**3 * x),
    "t v": (lambda m, x, v, t: t * t * v, lambda m, x, v, t: t**3 * v),
}
"""What changes need not do so at a constant rate: further terms."""


@dataclass(frozen=True, slots=True)
class Unnamed:
    """A law outside the catalogue, fitted in the place of effects that were to be named."""

    shape: str
    """Its name in `UNNAMED`."""
    kept: tuple[str, ...]
    """Effects beside it."""
    replaced: tuple[str, ...]
    """Effects in whose place it stands."""
    chi2: float
    size: int
    """Number of parameters, as a model's."""

    @property
    def words(self) -> str:
        """What it is, for a sentence."""
        return UNNAMED[self.shape]

    @property
    def experiment(self) -> str:
        """The experiment that shows it."""
        if self.shape in _BENT:
            return "Let the deck go from the same angle again, at once and after ten minutes: a board that changes differs."
        return (
            "Release from 3°, 7° and 12° to both sides, three times each: what repeats is a law, what does not is "
            "the board changing or the sensor."
        )


def unnamed_torques(searcher: Searcher, winner: Model) -> list[Unnamed]:
    """Fit every shape in the place of each of a model's effects, and of all of them together.

    Args:
        searcher: That found the model.
        winner: Fitted to single samples.

    Returns:
        The best of each place, fitted to single samples.
    """
    named = tuple(name for name in winner.effects if name not in searcher.base)
    places = dict.fromkeys([named, *((name,) for name in named)])
    return [_best(searcher, winner, place) for place in places]


def _best(searcher: Searcher, winner: Model, replaced: Sequence[str]) -> Unnamed:
    kept = tuple(name for name in winner.effects if name not in replaced)
    jobs = [(winner, kept, shape) for shape in UNNAMED]
    tried = [unnamed_model(searcher, *job) for job in jobs]
    shape, model = min(zip(UNNAMED, tried, strict=True), key=lambda pair: pair[1].chi2)
    fine = unnamed_model(searcher, winner, kept, shape, begin=model)
    clocks = len(searcher.records) * (shape in _BENT and fine.problem.free_states)
    return Unnamed(shape, kept, tuple(replaced), fine.chi2, fine.size - clocks)


def unnamed_model(
    searcher: Searcher, winner: Model, kept: tuple[str, ...], shape: str, *, begin: Model | None = None
) -> Model:
    """Return a joint with a torque of one shape fitted, from a model's parameters.

    Args:
        searcher: For its records.
        winner: The model.
        kept: Its effects that stay.
        shape: The torque's name in `UNNAMED`.
        begin: The same, fitted to averages; it is refined to single samples.
    """
    structure = Structure(kept, (_shaped(shape),))
    memory = bool(Structure(kept).internal_states)
    steps = int((COARSE if begin is None else FINE) * structure.sharpness)
    problem = Problem(
        structure, searcher.records, searcher.scales, bias=searcher.bias, steps_per_period=steps,
        average=searcher.average if begin is None else 1, free_states=winner.problem.free_states and memory,
        fixed={
            **defaults(kept), **searcher.fixed, "unnamed.amplitude": searcher.scales.amplitude,
            "unnamed.speed": searcher.scales.rate, "unnamed.duration": searcher.scales.duration,
        },
    )  # fmt: skip
    linear = {"stiffness": searcher.scales.stiffness, "damping": searcher.scales.damping}
    known = {**winner.parameters, **(linear if begin is None else begin.parameters)}
    start = problem.start({**dict.fromkeys(problem.names, 0.0), **known})
    if begin is not None:
        start[: len(problem.names)] = begin.minimum.point[: len(problem.names)]
        start[len(problem.names) :] = begin.minimum.point[len(problem.names) :]
    minimum = minimise(problem.normal, start, *problem.bounds(), iterations=20, tolerance=1e-5)
    return Model(effects=kept, problem=problem, minimum=minimum)


def _shaped(name: str) -> TorqueEffect:
    terms = (SHAPES[name], *_BENT.get(name, ()))

    def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
        x, v = motion.tilt / parameters["amplitude"], motion.rate / parameters["speed"]
        t = states[0] / parameters["duration"] if states else 0.0
        parts = [parameters[f"strength_{i}"] * shape(m, x, v, t) for i, shape in enumerate(terms)]
        return -sum(parts[1:], parts[0])

    clock = State(
        name="time", start=lambda m, tilt, hold, stiffness, parameters: 0.0 * tilt,
        size=lambda s: s.duration, rate=lambda m, motion, z, parameters: 1.0,
    )  # fmt: skip
    return TorqueEffect(
        name="unnamed",
        title=UNNAMED[name],
        parameters=(
            *(
                Parameter(
                    name=f"strength_{i}", unit="N*m", size=lambda s: 0.3 * s.torque, low=-10.0, high=10.0
                )
                for i in range(len(terms))
            ),
            Parameter(name="amplitude", unit="rad", size=lambda s: s.amplitude, low=0.0, high=2.0),
            Parameter(name="speed", unit="rad/s", size=lambda s: s.rate, low=0.0, high=2.0),
            Parameter(name="duration", unit="s", size=lambda s: s.duration, low=0.0, high=2.0),
        ),
        law=name,
        source="",
        does="",
        look_alikes=(),
        experiment="",
        mujoco=MujocoSupport(means="", since="", warp=False),
        to_mjcf=belongs_to_log,
        example=(),
        torque=torque,
        states=(clock,) if name in _BENT else (),
    )
