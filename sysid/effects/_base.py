"""What an effect is: a law with units, and everything that the tool and a user need to know about it.

Every effect is one file beside this one that ends in `EFFECT = TorqueEffect(...)`, `SensorEffect(...)` or
`SupportEffect(...)`. Its law is written once, against the small `Algebra`, and therefore runs both on CasADi
expressions and on plain numpy. Nothing outside this folder knows an effect by its name.

The law of the tilt joint, with roll φ, tilt x = φ - rest angle and rate v:

    I φ̈ = -k x - d v + Σ τ(x, v, φ, z),   ż = …
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, Literal, Protocol

import numpy as np

from sysid.effects._algebra import NUMPY, Algebra, Numbers, Value, Values
from sysid.roll import Array
from sysid.text import display

MjSpec = Any
"""A `mujoco.MjSpec`, and"""
MjsJoint = Any
"""a `mujoco.MjsJoint`: effects are known without MuJoCo, which has no types."""


@dataclass(frozen=True, slots=True)
class JointState:
    """State of the joint, as input of a torque law."""

    tilt: Value
    """x: roll less the rest angle (and less the support's, if the joint stands on one) [rad]."""
    rate: Value
    """v: rate of `tilt` [rad/s]."""
    roll: Value
    """φ: absolute roll of the deck [rad]."""
    stiffness: Value
    """The joint's linear stiffness k [N*m/rad]."""


@dataclass(frozen=True, slots=True)
class LinearJoint:
    """The numbers of the linear law."""

    inertia: Value
    """Roll inertia I [kg*m^2]."""
    stiffness: Value
    """Linear stiffness k [N*m/rad]."""
    damping: Value
    """Linear damping d [N*m*s/rad]."""
    rest_angle: Value
    """Roll at rest [rad]."""


@dataclass(frozen=True, slots=True)
class Reading:
    """A sensor's reading, at one instant or at many."""

    angle: Value
    """[rad]."""
    rate: Value
    """Its rate [rad/s]."""
    time: Value
    """On the log's clock [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scales:
    """Sizes of the problem at hand, from which starts and bounds are made."""

    inertia: float
    """Roll inertia [kg*m^2]."""
    stiffness: float
    """Linear stiffness that fits the decay alone [N*m/rad]."""
    damping: float
    """Linear damping that fits the decay alone [N*m*s/rad]."""
    amplitude: float
    """Largest tilt in the logs [rad]."""
    duration: float = 1.0
    """Longest release [s]."""

    @property
    def frequency(self) -> float:
        """Natural frequency [rad/s]."""
        return float(np.sqrt(self.stiffness / self.inertia))

    @property
    def rate(self) -> float:
        """Rate of an undamped swing of the largest amplitude [rad/s]."""
        return self.amplitude * self.frequency

    @property
    def torque(self) -> float:
        """Spring torque at the largest tilt [N*m]."""
        return self.stiffness * self.amplitude


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an effect: its unit, its size for a given problem, and where to look for it."""

    name: str
    unit: str
    size: Callable[[Scales], float]
    """A strength that clearly shows in the decay; the unit in which the fit works."""
    _: KW_ONLY
    low: float
    """Lower bound in units of `size`."""
    high: float
    """Upper bound in units of `size`."""
    starts: tuple[float, ...] = (0.1,)
    """Starting values in units of `size`; several where the cost has several valleys."""
    neutral: float | None = 0.0
    """Value at which the effect vanishes; None where no single value does."""
    default: float | None = None
    """Value taken where a user leaves the parameter out."""
    doubted: float = -np.inf
    """Value in units of `size` up to which the effect stands in for another, unless nothing but noise is left."""
    rough: bool = False
    """Whether the cost is rough along it, because it decides in which half swing the deck stops."""
    open_above: bool = False
    """Whether its upper bound is only how far it is looked for: there the effect is itself, too."""
    held: bool = False
    """Whether it is known from elsewhere: a fit holds it at the record's value, unless the user bounds it."""
    assumed: float = 0.0
    """Of one that is known from elsewhere, its standard deviation as a share of it where a record states none; 0 where it is exact."""

    def edged(self, value: float, *, exact: bool) -> bool:
        """Return whether a value, in units of `size`, is at an end of the range in which the effect is one.

        A share may be none or all; where nothing but noise is left of the log, `exact`, others may be at their ends too.
        """
        share = self.unit in ("", "1")
        if (share and self.low == 0.0) or (self.neutral is not None and self.low <= self.neutral):
            return False
        low = self.low if exact else max(self.low, self.doubted)
        closed = self.neutral is None and not share and not self.open_above
        return value <= 1.001 * low or (closed and value >= 0.999 * self.high)

    def bounds(self, scales: Scales) -> tuple[float, float]:
        """Return the bounds in `unit`."""
        size = self.size(scales)
        return self.low * size, self.high * size


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """One internal variable of an effect, e.g. the elongation of a Maxwell arm."""

    name: str
    start: Callable[[Algebra, Value, Value, Value, Values], Value]
    """`start(m, tilt, hold, stiffness, parameters)`: its value at release, after a hold of that length; a
    sensor's gets the absolute roll for the tilt."""
    size: Callable[[Scales], float]
    """Its typical size, for scaling when it is fitted."""
    most: float = 10.0
    """How far from zero the motion before a release can have brought it, in units of `size`."""
    rate: Callable[[Algebra, JointState, Sequence[Value], Values], Value] | None = None
    """`rate(m, motion, states, parameters)`: its time derivative, from all states of its effect."""
    late_release: Callable[[Algebra, Value, Value, Value, Values], Value] | None = None
    """For a sensor's: `late_release(m, roll, rate, acceleration, parameters)`, its value at a release noticed late, when the deck
    has that rate already."""
    in_motion: Callable[[Value, Value, LinearJoint, Values], Value] | None = None
    """For a sensor's: `in_motion(roll, rate, joint, parameters)`, its value in the midst of a decay, where no hold comes before."""
    detection_delay: Callable[[float, float, Numbers], float] | None = None
    """For a sensor's: `detection_delay(acceleration, noise, parameters)`, for how long a release does not show in its reading [s]."""
    settles: Callable[[Numbers], float] | None = None
    """`settles(parameters)`: how fast it comes to rest while the deck is held [1/s]; None where a hold leaves it as it is."""
    return_map: Callable[[Algebra, Value, Value, Values], Value] | None = None
    """For rate-independent states: `return_map(m, z, moved, parameters)`, what a tilt one way by `moved` makes of z."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MujocoSupport:
    """How an effect reaches MuJoCo, as data for the docs and the exporter."""

    means: str
    """What is written into the MJCF."""
    since: str
    """First MuJoCo version that runs it exactly ('' where none does, or it belongs to the log, not the model)."""
    warp: bool
    """Whether MuJoCo Warp of that version runs it."""
    substitute: str = ""
    """The nearest that MuJoCo has, where nothing in it is the effect; '' where not needed."""
    leaves_out: str = ""
    """The parameter that is not written, as nothing in MuJoCo is it; '' where all are. The effect without it has a 0 there."""

    @property
    def written(self) -> str:
        """What is written, in words."""
        return f"{self.means}; the nearest is: {self.substitute}" if self.substitute else self.means


class ToMjcf(Protocol):
    """Writes an effect into a spec."""

    def __call__(
        self, spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False
    ) -> tuple[str, ...]:
        """Add the effect to `joint` of `spec`, in place.

        The joint's `stiffness[0]`, `damping[0]` and `springref` hold the linear law already, its parent
        body carries the roll inertia, and its axis is "1 0 0". What is written runs in
        every MuJoCo from 3.11 on; `native=True` takes what the installed one has instead where that spares the model
        a body or an input.

        Returns:
            One line for each thing written, for the comments of the MJCF file.

        Raises:
            SysidError: MuJoCo cannot hold these parameters.
        """
        ...


FromMjcf = Callable[[MjsJoint], Sequence[float]]
"""Reads its parameters from the attributes of a model's joint, the opposite of `ToMjcf`; none where it is not there."""


def in_no_attribute(joint: MjsJoint) -> Sequence[float]:
    """Return nothing: the effect is in no attribute of a joint."""
    return ()


def unchanged(m: Algebra, reading: Reading, parameters: Values, states: Sequence[Value]) -> Reading:
    """Return the reading itself."""
    return reading


def belongs_to_log(
    spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False
) -> tuple[str, ...]:
    """Write nothing: the effect is in the measurement and must not go into the model."""
    return ()


BOARD_RANGE = 0.2
"""How far a board tilts [rad]: the angles in the experiments are shares of it."""

Family = Literal[
    "friction", "hysteresis", "drag", "hardening", "asymmetry", "stop", "freeplay", "relaxation", "rest", "drift",
    "lowpass", "clock", "inertia", "learned",
]  # fmt: skip
"""What a practitioner would call it; effects of one family are variants of one another."""
Role = Literal["torque", "learned", "support", "shift", "record", "measurement"]
"""What an effect changes: the torque of the joint, by a formula or by a table that is learned; what the joint stands on; the
rest angle; the numbers of the record (indistinguishable from another k and d in a free decay); or the sensor."""

DecaySign = Literal[
    "constant loss", "growing loss", "longer period", "shorter period", "moving level", "scattered levels", "stops aside"
]  # fmt: skip
"""What the peaks of a decay show: a loss per swing that does not depend on the amplitude, or more than in
proportion to it; a period that grows or falls with the amplitude; a level that moves with time; releases that come to rest
at several angles; a rest beside the middle of the swing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """Description of an effect; its kind (torque, support, sensor) adds how it acts."""

    name: str
    title: str
    """For people, e.g. 'dry friction'."""
    family: Family
    also_called: tuple[str, ...] = ()
    """Other words for it, in lower case, e.g. 'friction'; who asks for one is told the name."""
    parameters: tuple[Parameter, ...]
    role: Role
    law: str
    """The law as a formula, for the docs."""
    formula: str = ""
    """Its term on the left-hand side of the printed law, with `{parameter}` for values; '' where it has none."""
    source: str
    """Where the law comes from."""
    does: str
    """What it does to a decay, in one sentence."""
    look_alikes: tuple[str, ...]
    """Effects that make nearly the same decay."""
    experiment: str
    """The experiment that tells it from its look-alikes; `{3°}` is the angle of a board's release (see `experiment_on`)."""
    mujoco: MujocoSupport
    to_mjcf: ToMjcf
    from_mjcf: FromMjcf = in_no_attribute
    example: tuple[float, ...]
    """Parameters that show the effect clearly on the `pink` board, for pictures and tests."""
    states: tuple[State, ...] = ()
    limiting_cases: tuple[tuple[str, Callable[[Values], Sequence[dict[str, float]]]], ...] = ()
    """Simpler effects that this one turns into at the edge of its parameters, or nearly is, by name. The function takes all
    parameters of a joint ('stiffness', 'effect.parameter') and returns starts: those that change and those of the simpler
    effect; none where it is nothing like it."""
    idle: Callable[[Numbers, Scales], bool] | None = None
    """`idle(parameters, scales)`: whether no swing of such a size shows what it is, which leaves its states to stand for another law."""
    nonsmooth: bool = False
    """Whether its torque bends where no turning point is: a search then needs finer steps, and shorter first looks."""
    sharpness: float = 1.0
    """How many times the integration steps of a smooth joint it needs, for kinks or a mode of its own: with a sensor of
    0.04° at 1 kHz the integration should then change χ² by less than one, or by less than ten where it is nonsmooth."""
    identifiable_from_decay: bool = True
    """Whether a free decay can tell it from another stiffness and damping."""
    identifiable_with: tuple[str, ...] = ()
    """Effects of the record beside which a free decay can tell it after all."""
    same_as: tuple[str, ...] = ()
    """Effects, and parameters of the linear joint, that no free decay can tell it from."""
    excludes: tuple[str, ...] = ()
    """Effects that cannot be combined with it: it contains them, or they explain the same."""
    minimum_amplitude: float = 0.0
    """Tilt that a log must reach to tell it from the linear law [rad]."""
    record_direction: tuple[float, float] | None = None
    """In which proportion it changes ln k and ln d against the record; None where it does more than that."""
    stepped: tuple[str, ...] = ()
    """The parameters of a body of its own that a time step changes as it does the joint's inertia and damping."""
    decay_signs: tuple[tuple[DecaySign, int], ...] = ()
    """What the peaks of a decay show of it, and its place among the effects that show the same, the likeliest first."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of the command line."""
        return tuple(parameter.name for parameter in self.parameters)

    def experiment_on(self, *, slides: bool = False, widest: float = BOARD_RANGE) -> str:
        """Return the experiment with its releases in degrees; for a slide in mm, as large in its range [m] as those of a board."""
        show = display(is_rate=False, slides=slides)

        def said(angle: re.Match[str]) -> str:
            size = math.radians(float(angle[1]))
            return show(float(f"{size / BOARD_RANGE * widest:.1g}") if slides else size)

        return re.sub(r"\{([\d.]+)°\}", said, self.experiment)

    @property
    def is_known(self) -> bool:
        """Whether all of it is known from elsewhere: it is never left out of a joint that has it."""
        return bool(self.parameters) and all(parameter.held for parameter in self.parameters)

    @property
    def slides(self) -> bool:
        """Whether it is dry friction."""
        return False

    @property
    def part_of_joint(self) -> bool:
        """Whether it is in the board, and not in the log or in a simulator."""
        return True

    def named(self, values: Sequence[Value]) -> dict[str, Value]:
        """Return values in the parameters' order by name."""
        return dict(zip(self.parameter_names, values, strict=True))

    def of(self, parameters: Numbers) -> dict[str, float]:
        """Return its own among the parameters of a joint, which are 'effect.parameter'."""
        return {name: parameters[f"{self.name}.{name}"] for name in self.parameter_names}

    def term(self, values: Sequence[float]) -> str:
        """Return its term of the printed law with its sign, e.g. '+ 0.15 sgn φ̇'; '' where it has no formula."""
        if not self.formula:
            return ""
        sizes = {name: f"{abs(value):.3g}" for name, value in self.named(values).items()}
        return f"{'-' if values[0] < 0 else '+'} {self.formula.format(**sizes)}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Smoothness:
    """Smoothness of parameters that are a table of torques: their roughness, and what belongs to other parameters."""

    names: tuple[str, ...]
    """The parameters of the tables, in order; p in all."""
    tables: tuple[str, ...]
    """Names of the tables, which are smoothed by a weight each."""
    forms: tuple[Array, ...]
    """For each, a quadratic form in all parameters that is large where it is rough, shape (p, p)."""
    linear: Mapping[str, Array]
    """For a parameter of the linear joint the direction, shape (p,), in which the tables would do the same."""


def no_torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return zero torque."""
    return 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueEffect(Effect):
    """An effect of the joint itself: a torque, dry friction, or another number of the linear law."""

    role: Role = "torque"
    torque: Callable[[Algebra, JointState, Values, Sequence[Value]], Value] = no_torque
    """`torque(m, motion, parameters, states)` [N*m], without dry friction."""
    friction: Callable[[Algebra, Value, Value, Values], Value] | None = None
    """`friction(m, tilt, speed, parameters)` [N*m] ≥ 0: dry friction at x and |v|; at speed 0, what it takes to slide."""
    modifies: Callable[[LinearJoint, Values], LinearJoint] | None = None
    """`modifies(joint, parameters)`: the linear law with another number."""
    changing: Callable[[Algebra, Value, Values], tuple[Value, Value]] | None = None
    """`changing(m, roll, parameters)`: what it adds to the inertia there [kg*m^2], and the derivative of that by roll."""
    restarts: Callable[[Numbers], Sequence[dict[str, float]]] | None = None
    """Where to search again from if a search ended where no descent comes back from: at an edge beyond which the law does not change, or
    on one side of the joint. Takes and returns the effect's parameters in units of their sizes; none elsewhere."""
    grounded: bool = False
    """Whether it acts between deck and ground, past what the joint stands on."""
    adds_stiffness: str = ""
    """The parameter that adds to the joint's stiffness at small tilts; '' where none does."""
    slope: Callable[[Numbers, float], float] | None = None
    """`slope(parameters, roll)`: the stiffness that it is for small motions about a roll [N*m/rad], where no parameter of its
    own is that."""
    adds_inertia: str = ""
    """The parameter that adds to the joint's inertia; '' where none does."""
    acts_during_hold: bool = False
    """Whether a hand can hold the board against it, so that a release sets off faster than the spring alone makes it."""
    smoothness: Callable[[], Smoothness] | None = None
    """Of an effect that is a table which is learned: how it is kept smooth."""
    support: tuple[str, ...] = ()
    """Of such a one, the parameters that say where it was measured: lowest and highest tilt, lowest and highest rate."""
    memory: str = ""
    """Of such a one, the effect that it is tried with where tilt and rate alone leave something."""
    timestep: str = ""
    """The parameter that is a simulator's time step, where the effect is that simulator; else ''."""

    def stiffness_at(self, roll: float, parameters: Numbers) -> float:
        """Return its contribution to the joint's stiffness for small motions about a roll [N*m/rad]."""
        return (
            parameters.get(self.adds_stiffness, 0.0) if self.slope is None else self.slope(parameters, roll)
        )

    def dragged_stiffness(self, tilt: float, stiffness: float, parameters: Numbers) -> float:
        """Return how hard its internal states pull where the joint was dragged from rest, over that tilt [rad] [N*m/rad].

        The joint's own stiffness [N*m/rad] counts beside them.
        """
        if not self.states:
            return 0.0
        states = [state.start(NUMPY, tilt, 0.0, stiffness, parameters) for state in self.states]
        return -float(self.torque(NUMPY, JointState(tilt, 0.0, tilt, stiffness), parameters, states)) / tilt

    @property
    def slides(self) -> bool:
        """Whether it is dry friction."""
        return self.friction is not None

    @property
    def part_of_joint(self) -> bool:
        """Whether it is in the board, and not in the log or in a simulator."""
        return not self.timestep


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorEffect(Effect):
    """An effect of the sensor or of the log: the board does not have it.

    One with internal states is integrated with the joint; one without is applied to the samples after those, in the
    catalogue's order.
    """

    role: Role = "measurement"
    to_mjcf: ToMjcf = belongs_to_log
    mujoco: MujocoSupport = MujocoSupport(means="nothing: it belongs to the log", since="", warp=False)
    observe: Callable[[Algebra, Reading, Values, Sequence[Value]], Reading] = unchanged
    """`observe(m, reading, parameters, states)`: what it makes of a reading."""
    clock_ratio: str = ""
    """The parameter by which the log's clock counts too much time, where the effect is such a clock; else ''."""

    @property
    def part_of_joint(self) -> bool:
        """Whether it is in the board, and not in the log or in a simulator."""
        return False


@dataclass(frozen=True, slots=True, kw_only=True)
class SupportEffect(Effect):
    """A compliant support of the joint, as a body of its own. Its two states are its roll and its rate."""

    role: Role = "support"
    acceleration: Callable[[Algebra, Value, Value, Value, Values], Value]
    """`acceleration(m, angle, rate, torque, parameters)` of the support [rad/s^2], which the joint turns with -torque."""
    series_stiffness: str
    """The parameter that is a stiffness in series with the joint's."""
