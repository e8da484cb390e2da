"""Description of an effect: its law with units, and all facts that the tool and a user need.

Every effect is one file beside this one that ends in `EFFECT = TorqueEffect(...)`, `SensorEffect(...)`,
`SupportEffect(...)` or `DriveEffect(...)`. Its law is written once, with the functions of `Algebra`, and runs on CasADi
expressions and on plain numpy. Code outside this folder does not use the name of an effect.

The law of the tilt joint, with roll φ, tilt x = φ - rest angle and rate v, is `I φ̈ = -k x - d v + Σ τ(x, v, φ, z)`, with states ż = ….
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from sysid.effects._algebra import NUMPY, Algebra, Numbers, States, Value, Values
from sysid.errors import SysidError
from sysid.roll import Array
from sysid.text import display

MjSpec = Any
"""A `mujoco.MjSpec`: the catalogue loads without MuJoCo, which has no types."""
MjsJoint = Any
"""A `mujoco.MjsJoint`."""


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
    """Sizes of the problem at hand; they scale starts and bounds."""

    inertia: float
    """Roll inertia [kg*m^2]."""
    stiffness: float
    """Linear stiffness of a fit without effects [N*m/rad]."""
    damping: float
    """Linear damping of a fit without effects [N*m*s/rad]."""
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


def usual_size(unit: str) -> Callable[[Scales], float] | None:
    """Return the size of a parameter that its unit decides; None for other units."""
    return {
        "rad": lambda s: s.amplitude, "rad/s": lambda s: s.rate, "s": lambda s: 1.0 / s.frequency, "N*m": lambda s: s.torque,
        "N*m/rad": lambda s: s.stiffness, "N*m*s/rad": lambda s: s.stiffness / s.frequency, "kg*m^2": lambda s: s.inertia,
        "1": lambda s: 1.0, "": lambda s: 1.0,
    }.get(unit)  # fmt: skip


def _by_unit(scales: Scales) -> float:
    """Stand for `usual_size` until the unit is known."""
    raise NotImplementedError


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an effect: its unit, its size for a given problem, and its range."""

    name: str
    unit: str
    size: Callable[[Scales], float] = _by_unit
    """A value that clearly shows in the decay; the fit's unit. It follows from the unit if left out."""
    _: KW_ONLY
    low: float
    """Lower bound in units of `size`."""
    high: float
    """Upper bound in units of `size`."""
    starts: tuple[float, ...] = (0.1,)
    """Starting values in units of `size`; several if the cost has several minima."""
    neutral: float | None = 0.0
    """Value at which the effect vanishes; None without such a value."""
    default: float | None = None
    """Value if a user leaves the parameter out."""
    rough: bool = False
    """Whether the cost is rough along it, because it decides in which half swing the deck stops."""
    held: bool = False
    """Whether it is known from another source: a fit holds it at the record's value, unless the user bounds it."""
    assumed: float = 0.0
    """Relative standard deviation of a held parameter if the record has none; 0 if it is exact."""

    def __post_init__(self) -> None:
        """Take the size that the unit has.

        Raises:
            SysidError: The unit has no usual size.
        """
        if self.size is _by_unit:
            found = usual_size(self.unit)
            if found is None:
                raise SysidError(
                    f"parameter '{self.name}': '{self.unit}' has no usual size. Give one: size=lambda s: s.torque / ..."
                )
            object.__setattr__(self, "size", found)


def at_zero(m: Algebra, tilt: Value, hold: Value, stiffness: Value, parameters: Values) -> Value:
    """Return 0."""
    return 0 * tilt


def at_tilt(m: Algebra, tilt: Value, hold: Value, stiffness: Value, parameters: Values) -> Value:
    """Return the angle of the joint."""
    return tilt


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """One internal variable of an effect, e.g. the elongation of a Maxwell arm."""

    name: str
    start: Callable[[Algebra, Value, Value, Value, Values], Value] = at_zero
    """`start(m, tilt, hold, stiffness, parameters)`: its value at release, after a hold of that length; for a sensor `tilt` is the
    absolute roll."""
    size: Callable[[Scales], float]
    """Its typical size, to scale a fit."""
    most: float = 10.0
    """Its largest size at a release, after any motion before, in units of `size`."""
    rate: Callable[[Algebra, JointState, States, Values], Value] | None = None
    """`rate(m, motion, states, parameters)`: its time derivative, from all states of its effect."""
    sensed: Callable[[Algebra, Value, Value, Value, LinearJoint, Values], Value] | None = None
    """Of a sensor, where a fit begins: `sensed(m, roll, rate, hold, joint, parameters)`, with that roll and rate of the joint."""
    detection_delay: Callable[[float, float, Numbers], float] | None = None
    """Of a sensor: `detection_delay(acceleration, noise, parameters)`, the time until a release shows in its reading [s]."""
    return_map: Callable[[Algebra, Value, Value, Values], Value] | None = None
    """For rate-independent states: `return_map(m, z, moved, parameters)`, z after a tilt by `moved` in one direction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MujocoSupport:
    """Representation of an effect in MuJoCo, for the docs and the exporter."""

    means: str
    """MJCF elements or attributes."""
    substitute: str = ""
    """Nearest form if MuJoCo has no exact one, else ''."""
    leaves_out: str = ""
    """Parameter without a form in MuJoCo, else ''; at 0 it has no effect."""

    @property
    def written(self) -> str:
        """Its form in the MJCF, in words."""
        return f"{self.means}; the nearest is: {self.substitute}" if self.substitute else self.means


class ToMjcf(Protocol):
    """Writes an effect into a spec."""

    def __call__(
        self, spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False
    ) -> tuple[str, ...]:
        """Add the effect to `joint` of `spec`, in place.

        The joint's `stiffness[0]`, `damping[0]` and `springref` hold the linear law already, its parent
        body has the roll inertia, and its axis is "1 0 0". The result runs in every MuJoCo from 3.11 on. `native=True`
        uses newer features of the installed one if they spare the model a body or an input.

        Returns:
            One line for each element written, for the comments of the MJCF file.

        Raises:
            SysidError: MuJoCo cannot hold these parameters.
        """
        ...


FromMjcf = Callable[[MjsJoint], Sequence[float]]
"""Reads its parameters from the attributes of a model's joint, the inverse of `ToMjcf`; empty if the model lacks the effect."""


def in_no_attribute(joint: MjsJoint) -> Sequence[float]:
    """Return no parameters: the effect has no attribute of a joint."""
    return ()


def unchanged(m: Algebra, reading: Reading, parameters: Values, states: States) -> Reading:
    """Return the reading itself."""
    return reading


def left_out(*reasons: str) -> ToMjcf:
    """Return a writer that writes nothing but reasons."""

    def write(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
        return reasons

    return write


BELONGS_TO_LOG = left_out()
"""Writes nothing: the effect belongs to the measurement, not to the model."""


BOARD_RANGE = 0.2
"""Tilt range of a board [rad]; the angles in the experiments are given for it."""

Family = Literal[
    "friction", "hysteresis", "drag", "hardening", "asymmetry", "stop", "freeplay", "relaxation", "rest", "drift",
    "lowpass", "clock", "inertia", "learned", "gains", "delay", "saturation", "backlash", "compliance", "cogging",
]  # fmt: skip
"""Everyday kinds of effects; effects of one family are variants of one another."""
Role = Literal["torque", "learned", "support", "shift", "record", "measurement", "drive"]
"""The part that an effect changes. 'learned' is a torque by a table, and 'shift' moves the rest angle. 'record' stands for numbers that
a free decay leaves open."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """Description of an effect; its kind (torque, support, sensor) adds how it acts."""

    name: str
    title: str
    """For people, e.g. 'dry friction'."""
    family: Family
    also_called: tuple[str, ...] = ()
    """Everyday names in lower case, e.g. 'friction'; error messages translate them."""
    parameters: tuple[Parameter, ...]
    role: Role
    law: str
    """The law as a formula, for the docs."""
    formula: str = ""
    """Its term on the left-hand side of the printed law, with `{parameter}` for values; '' without one."""
    source: str
    """Source of the law."""
    does: str
    """Its effect on a decay, in one sentence."""
    look_alikes: tuple[str, ...]
    """Effects that make nearly the same decay."""
    experiment: str
    """Experiment that separates it from its look-alikes; `{3°}` is the angle of a board's release (see `experiment_on`)."""
    mujoco: MujocoSupport
    to_mjcf: ToMjcf
    from_mjcf: FromMjcf = in_no_attribute
    example: tuple[float, ...]
    """Parameters that show the effect clearly on the `pink` board, for pictures and tests."""
    states: tuple[State, ...] = ()
    nonsmooth: bool = False
    """Whether its torque has kinks besides turning points: a search then needs finer steps and shorter first windows."""
    identifiable_from_decay: bool = True
    """Whether a free decay separates it from another stiffness and damping."""
    identifiable_with: tuple[str, ...] = ()
    """Effects of the record that make it identifiable from a free decay."""
    same_as: tuple[str, ...] = ()
    """Effects, and parameters of the linear joint, that are the same in every free decay."""
    excludes: tuple[str, ...] = ()
    """Effects that cannot be combined with it: it contains them, or they explain the same."""
    record_direction: tuple[float, float] | None = None
    """Its changes of ln k and ln d against the record, as a ratio; None if it has other consequences too."""
    stepped: tuple[str, ...] = ()
    """Parameters of a body of its own; a time step changes them like the joint's inertia and damping."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of the command line."""
        return tuple(parameter.name for parameter in self.parameters)

    def experiment_on(self, *, slides: bool = False, widest: float = BOARD_RANGE) -> str:
        """Return the experiment with its releases in degrees; for a slide in mm, scaled to its range [m]."""
        show = display(is_rate=False, slides=slides)

        def said(angle: re.Match[str]) -> str:
            size = math.radians(float(angle[1]))
            return show(float(f"{size / BOARD_RANGE * widest:.1g}") if slides else size)

        return re.sub(r"\{([\d.]+)°\}", said, self.experiment)

    @property
    def is_known(self) -> bool:
        """Whether all its parameters are held: a joint that has it always keeps it."""
        return bool(self.parameters) and all(parameter.held for parameter in self.parameters)

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
    """Prior of a learned torque: coordinates of its tables in which the roughness is diagonal."""

    names: tuple[str, ...]
    """Parameters of the tables, in order; p in all."""
    space: Array
    """Table values of each coordinate, orthonormal, shape (p, q). Spring and damper hold the directions that are missing."""
    roughness: Array
    """Roughness of each coordinate, shape (q,)."""
    part: npt.NDArray[np.intp]
    """Part of the tables to which each coordinate belongs, shape (q,). Each part has its own weight."""

    def weighted(self, weights: Sequence[float]) -> Array:
        """Return the roughness of each coordinate times the weight of its part [1], shape (q,)."""
        return self.roughness * np.array(weights)[self.part]


def no_torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return zero torque."""
    return 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueEffect(Effect):
    """An effect of the joint itself: a torque, dry friction, or another number of the linear law."""

    role: Role = "torque"
    torque: Callable[[Algebra, JointState, Values, States], Value] = no_torque
    """`torque(m, motion, parameters, states)` [N*m], without dry friction."""
    friction: Callable[[Algebra, Value, Value, Values], Value] | None = None
    """`friction(m, tilt, speed, parameters)` [N*m] ≥ 0: dry friction at x and |v|; at speed 0, the breakaway torque."""
    modifies: Callable[[LinearJoint, Values], LinearJoint] | None = None
    """`modifies(joint, parameters)`: the linear law with another number."""
    changing: Callable[[Algebra, Value, Values], tuple[Value, Value]] | None = None
    """`changing(m, roll, parameters)`: the inertia that it adds at a roll [kg*m^2], and its derivative by roll."""
    restarts: Callable[[Numbers], Sequence[dict[str, float]]] | None = None
    """New starts after a search that ended in a trap: beyond an edge without gradient, or on one side of the joint. Takes and returns
    the effect's parameters in units of their sizes; empty if the search is not trapped."""
    grounded: bool = False
    """Whether it acts between deck and ground, not between deck and support."""
    adds_stiffness: str = ""
    """Parameter that adds to the joint's stiffness at small tilts, else ''."""
    slope: Callable[[Numbers, float], float] | None = None
    """`slope(parameters, roll)`: its stiffness for small motions about a roll [N*m/rad]; None if `adds_stiffness` is that."""
    adds_inertia: str = ""
    """Parameter that adds to the joint's inertia, else ''."""
    acts_during_hold: bool = False
    """Whether a hand can hold the board against it; a release then starts faster than with the spring alone."""
    smoothness: Callable[[], Smoothness] | None = None
    """Of a learned table: its smoothness."""
    support: tuple[str, ...] = ()
    """Of a learned table: the parameters of the measured range (lowest and highest tilt, lowest and highest rate)."""
    timestep: str = ""
    """Parameter that is the time step, if the effect is a simulator; else ''."""

    def stiffness_at(self, roll: float, parameters: Numbers) -> float:
        """Return its contribution to the joint's stiffness for small motions about a roll [N*m/rad]."""
        return (
            parameters.get(self.adds_stiffness, 0.0) if self.slope is None else self.slope(parameters, roll)
        )

    def dragged_stiffness(self, tilt: float, stiffness: float, parameters: Numbers) -> float:
        """Return the torque of its internal states after a drag from rest to a tilt [rad], over that tilt [N*m/rad].

        `stiffness` is the joint's own [N*m/rad].
        """
        if not self.states:
            return 0.0
        states = [state.start(NUMPY, tilt, 0.0, stiffness, parameters) for state in self.states]
        return -float(self.torque(NUMPY, JointState(tilt, 0.0, tilt, stiffness), parameters, states)) / tilt


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorEffect(Effect):
    """An effect of the sensor or of the log, not of the board.

    One with internal states is integrated with the joint. The others are applied to its samples, in the catalogue's
    order.
    """

    role: Role = "measurement"
    to_mjcf: ToMjcf = BELONGS_TO_LOG
    mujoco: MujocoSupport = MujocoSupport(means="nothing: it belongs to the log")
    observe: Callable[[Algebra, Reading, Values, States], Reading] = unchanged
    """`observe(m, reading, parameters, states)`: the reading after this effect."""
    clock_ratio: str = ""
    """Parameter that is the ratio of the log's time to true time, if the effect is a clock; else ''."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SupportEffect(Effect):
    """A compliant support of the joint, as a body of its own. Its two states are its roll and its rate."""

    role: Role = "support"
    acceleration: Callable[[Algebra, Value, Value, Value, Values], Value]
    """`acceleration(m, angle, rate, torque, parameters)` of the support [rad/s^2]; the joint acts on it with -torque."""
    series_stiffness: str
    """The parameter that is a stiffness in series with the joint's."""


@dataclass(frozen=True, slots=True)
class Actuation:
    """Inputs of an actuator at one instant."""

    input: Value
    """The input of the log after the delay, in its own unit."""
    torque: Value
    """Torque after the effects before this one [N*m]."""
    angle: Value
    """Angle of the encoder [rad]."""
    rate: Value
    """Its rate [rad/s]."""


def _same_torque(m: Algebra, actuation: Actuation, parameters: Values) -> Value:
    return actuation.torque


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveEffect(Effect):
    """An effect of the actuator: it shows only while something drives the joint."""

    role: Role = "drive"
    stage: int
    """Its place from the input to the joint: lower ones act first."""
    sources: tuple[str, ...] = ()
    """Kinds of input that it turns into a torque; empty if it changes a torque."""
    act: Callable[[Algebra, Actuation, Values], Value] = _same_torque
    """`act(m, actuation, parameters)`: the torque after this effect [N*m]."""
    late: str = ""
    """Parameter that is the delay of the input [s]."""
    transmit: Callable[[Algebra, Value, Value, Values], Value] | None = None
    """`transmit(m, twist, rate, parameters)`: torque of a gear between rotor and joint [N*m]; None if they are one body."""
