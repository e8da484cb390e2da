"""Synthetic logs with a known truth, independent of the model that is fitted.

`synthesise` moves a board as a person would record it (rest, pushed over, held, let go, again), with any
effects of the catalogue in its true law, and passes the motion through a sensor.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sysid.board import Board
from sysid.errors import HuskyError, did_you_mean
from sysid.files import write_json
from sysid.roll import Release, Roll
from sysid.synth_hand import HandMotion, hand_motion
from sysid.synth_physics import Condition, Modes, TrueLaw, simulate
from sysid.synth_sensors import Dialect, Sensor, measure, write_log

Array = npt.NDArray[np.float64]


MOST_SAMPLES = 2e7
"""Five and a half hours at 1 kHz."""


class Parameter(NamedTuple):
    """One number of an effect."""

    name: str
    unit: str
    positive: bool
    default: float | None = None


PARAMETERS: Mapping[str, tuple[Parameter, ...]] = {
    "coulomb": (Parameter("torque", "N*m", True),),
    "stribeck": (
        Parameter("torque", "N*m", True),
        Parameter("static_torque", "N*m", True),
        Parameter("velocity", "rad/s", True),
    ),
    "quadratic-damping": (Parameter("coefficient", "N*m*s^2/rad^2", False),),
    "cubic-damping": (Parameter("coefficient", "N*m*s^3/rad^3", False),),
    "cubic-stiffness": (Parameter("coefficient", "N*m/rad^3", False),),
    "asymmetric-stiffness": (Parameter("coefficient", "N*m/rad^2", False),),
    "gravity": (Parameter("moment", "N*m", False),),
    "end-stop": (
        Parameter("angle", "rad", True),
        Parameter("stiffness", "N*m/rad", True),
        Parameter("damping", "N*m*s/rad", False, 0.0),
    ),
    "freeplay": (Parameter("half_width", "rad", True),),
    "preload": (Parameter("torque", "N*m", False),),
    "offset": (Parameter("angle", "rad", False),),
    "viscoelastic": (Parameter("stiffness", "N*m/rad", True), Parameter("time_constant", "s", True)),
    "hysteresis": (Parameter("stiffness", "N*m/rad", True), Parameter("torque", "N*m", True)),
    "second-mode": (
        Parameter("inertia", "kg*m^2", True),
        Parameter("stiffness", "N*m/rad", True),
        Parameter("damping", "N*m*s/rad", False),
    ),
    "inertia": (Parameter("ratio", "1", True),),
    "discretisation": (Parameter("timestep", "s", True),),
    "sensor-bias": (Parameter("angle", "rad", False),),
    "sensor-drift": (Parameter("rate", "rad/s", False),),
    "clock": (Parameter("ratio", "1", True),),
    "lowpass": (Parameter("time_constant", "s", True),),
}
"""Effects that a synthetic board can have, and their parameters in order."""

_LAW_FIELDS: Mapping[str, tuple[str, ...]] = {
    "quadratic-damping": ("quadratic_damping",),
    "cubic-damping": ("cubic_damping",),
    "cubic-stiffness": ("cubic_stiffness",),
    "asymmetric-stiffness": ("even_stiffness",),
    "gravity": ("gravity",),
    "end-stop": ("stop_angle", "stop_stiffness", "stop_damping"),
    "freeplay": ("half_gap",),
    "preload": ("preload",),
    "viscoelastic": ("arm_stiffness", "arm_time"),
    "hysteresis": ("slider_stiffness", "slider_torque"),
    "second-mode": ("support_inertia", "support_stiffness", "support_damping"),
}
_SENSOR_FIELDS = {
    "sensor-bias": "bias",
    "sensor-drift": "drift",
    "clock": "clock",
    "lowpass": "time_constant",
}
_STEPPED = {"quadratic-damping", "cubic-damping", "cubic-stiffness", "asymmetric-stiffness", "gravity"} | {
    "preload", "offset", "inertia", "discretisation", *_SENSOR_FIELDS,
}  # fmt: skip
"""What may go together with 'discretisation': laws without kinks and without memory."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SynthOptions:
    """How the board is moved and recorded."""

    angles: tuple[float, ...] = (math.radians(10.0),)
    """Roll at each release [rad], right edge down positive."""
    rate: float = 1000.0
    """Sampling rate [Hz]."""
    duration: float = 2.0
    """Time left to each free decay [s]."""
    hold: float = 0.6
    """Time for which the deck is held before each release [s]."""
    push: float = 0.5
    """Time that the hand takes to push the deck over [s]."""
    lead: float = 0.6
    """Untouched rest at the start of the log [s]."""
    tremor: float = math.radians(0.03)
    """Root mean square tremor of the holding hand [rad]."""
    hand: bool = True
    """Keep rest and hand in the log; without, a log of one release starts at the release."""
    jitter: float = 0.0
    """Standard deviation of the sampling instants, in sampling periods; the stamps tell the truth."""
    dropout: float = 0.0
    """Share of samples that are missing, lost in runs of about five."""
    seed: int = 0
    dialect: Dialect = "angle"
    sensor: Sensor = field(default_factory=lambda: Sensor(noise=math.radians(0.1)))


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueRelease:
    """What happened at one release, on the log's clock."""

    start: float
    """Time of letting go [s]."""
    end: float
    """Time at which the hand takes the deck again or the log ends [s]."""
    angle: float
    """True roll then [rad]."""
    rate: float
    """True roll rate then [rad/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SyntheticLog:
    """A log and the truth behind it."""

    board: str
    law: TrueLaw
    effects: Mapping[str, tuple[float, ...]]
    options: SynthOptions
    time: Array
    """Time stamps [s], shape (n,)."""
    channels: Array
    """What the sensor read, shape (n, channels) (see `measure`)."""
    true_motion: Array
    """True roll [rad], rate [rad/s] and acceleration [rad/s^2], shape (n, 3); the last is 0 where no
    sensor needs it."""
    releases: tuple[TrueRelease, ...]

    def to_roll(self, name: str = "synthetic") -> Roll:
        """Return an angle log as the reader would.

        Raises:
            HuskyError: The log holds no angle.
        """
        if self.channels.shape[1] != 1 or self.options.dialect == "gyro":
            raise HuskyError(f"a log of dialect '{self.options.dialect}' holds no angle; read it as a file.")
        roll = self.channels[:, 0]
        return Roll(
            log=name, time=self.time, roll=roll, std=np.full(len(roll), self.angle_std), origin="angle"
        )

    @property
    def angle_std(self) -> float:
        """Standard deviation of one angle sample [rad]: white noise and rounding."""
        sensor = self.options.sensor
        return math.hypot(sensor.noise, sensor.quantisation / math.sqrt(12))

    def to_releases(self, name: str = "synthetic") -> list[Release]:
        """Return the free decays of an angle log, cut where they truly begin and end.

        Raises:
            HuskyError: The log holds no angle.
        """
        roll = self.to_roll(name)
        rest = self.law.equilibrium() + self.options.sensor.bias
        found: list[Release] = []
        for number, true in enumerate(self.releases, start=1):
            part = slice(*np.searchsorted(roll.time, (true.start - 1e-9, true.end - 1e-9)).tolist())
            found.append(
                Release(
                    log=name, number=number, time=roll.time[part], roll=roll.roll[part], std=roll.std[part],
                    origin="angle", rest=rest, hold=self.options.hold, end="log",
                )
            )  # fmt: skip
        return found

    def truth(self) -> dict[str, Any]:
        """Return everything that is true of the log, as JSON-ready data."""
        law, sensor = self.law, self.options.sensor
        parameters = {
            "inertia": {"value": law.inertia, "unit": "kg*m^2"},
            "stiffness": {"value": law.stiffness, "unit": "N*m/rad"},
            "damping": {"value": law.damping, "unit": "N*m*s/rad"},
            "rest_angle": {"value": law.rest, "unit": "rad"},
        }
        effects = [
            {
                "name": name,
                "parameters": {
                    parameter.name: {"value": value, "unit": parameter.unit}
                    for parameter, value in zip(PARAMETERS[name], values, strict=True)
                },
            }
            for name, values in self.effects.items()
        ]
        options: dict[str, Any] = {
            name: getattr(self.options, name)
            for name in self.options.__dataclass_fields__
            if name not in ("sensor", "seed", "angles")
        }
        return {
            "synthetic": True,
            "board": self.board,
            "parameters": parameters,
            "effects": effects,
            "releases": [
                {
                    "t_start_s": release.start,
                    "t_end_s": release.end,
                    "angle_rad": release.angle,
                    "rate_rad_s": release.rate,
                }
                for release in self.releases
            ],
            "seed": self.options.seed,
            "samples": len(self.time),
            "options": {**options, "angles": list(self.options.angles)},
            "sensor": {name: getattr(sensor, name) for name in sensor.__dataclass_fields__},
        }

    def save(self, path: Path, command: str = "") -> tuple[Path, Path]:
        """Write the log and, beside it, the truth; return both paths.

        Raises:
            HuskyError: The name does not go with the dialect, or the folder cannot be written to.
        """
        truth = path.with_suffix(".truth.json")
        write_log(path, self.time, self.channels, self.options.dialect)
        write_json(truth, {**self.truth(), "command": command} if command else self.truth())
        return path, truth


def parse_effect(text: str) -> tuple[str, tuple[float, ...]]:
    """Return name and parameters of 'NAME=V[,V...]'.

    Raises:
        HuskyError: The text is not of that form, or the effect is unknown.
    """
    name, equals, values = text.partition("=")
    check_effect_name(name)
    if not equals or not values:
        wanted = ",".join(f"{p.name.upper()}" for p in PARAMETERS[name])
        raise HuskyError(f"effect '{name}' has no value; write {name}={wanted}{_units(name)}.")
    try:
        return name, tuple(float(value) for value in values.split(","))
    except ValueError:
        raise HuskyError(f"effect '{text}': '{values}' is not a list of numbers{_units(name)}.") from None


def check_effect_name(name: str) -> None:
    """Accept the name of an effect.

    Raises:
        HuskyError: There is none of that name.
    """
    if name not in PARAMETERS:
        raise HuskyError(
            f"unknown effect '{name}'.{did_you_mean(name, PARAMETERS)} Known: {', '.join(PARAMETERS)}."
        )


def _units(name: str) -> str:
    return " (" + ", ".join(f"{p.name} in {p.unit}" for p in PARAMETERS[name]) + ")"


def complete_effects(effects: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, ...]]:
    """Return the effects with their optional parameters filled in.

    Raises:
        HuskyError: An effect is unknown, or a parameter is missing, superfluous or out of range.
    """
    complete: dict[str, tuple[float, ...]] = {}
    for name, values in effects.items():
        check_effect_name(name)
        parameters = PARAMETERS[name]
        needed = sum(parameter.default is None for parameter in parameters)
        if not needed <= len(values) <= len(parameters):
            raise HuskyError(
                f"effect '{name}' has {len(values)} parameters; expected {needed}{_units(name)}."
            )
        filled = [*map(float, values), *(p.default or 0.0 for p in parameters[len(values) :])]
        for parameter, value in zip(parameters, filled, strict=True):
            if not math.isfinite(value) or (parameter.positive and value <= 0):
                kind = "a positive" if parameter.positive else "a finite"
                raise HuskyError(f"effect '{name}': {parameter.name} is {value:g}; expected {kind} number.")
        complete[name] = tuple(filled)
    if "stribeck" in complete and complete["stribeck"][1] < complete["stribeck"][0]:
        raise HuskyError(
            "effect 'stribeck': static_torque is below torque; static friction is the larger one."
        )
    return complete


def true_law(board: Board, effects: Mapping[str, Sequence[float]]) -> TrueLaw:
    """Return the true joint of a board with effects.

    Raises:
        HuskyError: An effect is unknown or its parameters are wrong.
    """
    effects = complete_effects(effects)
    fields = {
        field: value
        for name, names in _LAW_FIELDS.items()
        if name in effects
        for field, value in zip(names, effects[name], strict=True)
    }
    if "stribeck" in effects:
        sliding, static, fields["stribeck_velocity"] = effects["stribeck"]
        fields["friction"], fields["static_friction"] = sliding, static
    for key in ("friction", "static_friction") if "coulomb" in effects else ():
        fields[key] = fields.get(key, 0.0) + effects["coulomb"][0]
    return TrueLaw(
        inertia=board.inertia.value * effects.get("inertia", (1.0,))[0],
        stiffness=board.stiffness,
        damping=board.damping,
        rest=board.rest_angle + effects.get("offset", (0.0,))[0],
        **fields,
    )


def synthesise(
    board: Board, effects: Mapping[str, Sequence[float]] | None = None, options: SynthOptions | None = None
) -> SyntheticLog:
    """Record a board that behaves by its record and by `effects`, which add to the record's own.

    Args:
        board: Gives inertia, stiffness, damping, rest angle and effects.
        effects: Name and parameters, in the order of `PARAMETERS`; an effect that the record has too is
            replaced by the one given here.
        options: How it is moved and recorded.

    Raises:
        HuskyError: An effect or an option is out of range.
    """
    options = options or SynthOptions()
    recorded = {effect.name: [q.value for q in effect.parameters.values()] for effect in board.effects}
    chosen = complete_effects({**recorded, **(effects or {})})
    _check(options, chosen)
    law = true_law(board, chosen)
    given = {field: chosen[name][0] for name, field in _SENSOR_FIELDS.items() if name in chosen}
    options = replace(options, sensor=replace(options.sensor, **given))
    physics, sensing = np.random.default_rng(options.seed).spawn(2)
    time, motion, releases = _move(law, options, chosen.get("discretisation", (0.0,))[0], physics)
    if not options.hand:
        first = releases[0].start
        kept = time >= first - 1e-9
        time, motion = np.maximum(time[kept] - first, 0.0), motion[kept]
        releases = [replace(releases[0], start=0.0, end=releases[0].end - first)]
    channels = measure(time, motion, options.sensor, options.dialect, sensing)
    kept = _kept(len(time), options.dropout, sensing)
    ratio = options.sensor.clock
    return SyntheticLog(
        board=board.name, law=law, effects=chosen, options=options,
        time=ratio * time[kept], channels=channels[kept], true_motion=motion[kept],
        releases=tuple(
            replace(r, start=round(ratio * r.start, 9), end=round(ratio * r.end, 9)) for r in releases
        ),
    )  # fmt: skip


def _check(options: SynthOptions, effects: Mapping[str, object]) -> None:
    def refuse(what: str, value: object, expected: str) -> None:
        raise HuskyError(f"{what} is {value}; expected {expected}.")

    if not options.angles:
        refuse("the number of releases", 0, "at least one")
    for angle in options.angles:
        if not 0 < abs(angle) < math.pi / 2:
            refuse("a release angle", f"{math.degrees(angle):g} degrees", "0 to 90 degrees to either side")
    for name in ("rate", "duration", "push"):
        if not 0 < getattr(options, name) < math.inf:
            refuse(f"the {name}", getattr(options, name), "a positive number")
    for name in ("hold", "lead", "tremor"):
        if not 0 <= getattr(options, name) < math.inf:
            refuse(f"the {name}", getattr(options, name), "0 or more")
    for name in ("noise", "quantisation", "gyro_noise", "accelerometer_noise"):
        if not 0 <= getattr(options.sensor, name) < math.inf:
            refuse(f"the {name.replace('_', ' ')}", getattr(options.sensor, name), "0 or more")
    if not all(map(math.isfinite, (*options.sensor.lever_arm, options.sensor.gyro_bias))):
        refuse("lever arm or gyro bias", "not finite", "finite numbers")
    if options.seed < 0:
        refuse("the seed", options.seed, "0 or more")
    seconds = options.lead + len(options.angles) * (options.push + options.hold + options.duration)
    if not seconds * options.rate <= MOST_SAMPLES:
        refuse("the number of samples", f"{seconds * options.rate:.3g}", f"at most {MOST_SAMPLES:.0e}")
    if not 0 <= options.jitter <= 0.3:
        refuse("the jitter", options.jitter, "0 to 0.3 sampling periods, or samples would change places")
    if not 0 <= options.dropout <= 0.9:
        refuse("the dropout", options.dropout, "a share from 0 to 0.9")
    if not options.hand and len(options.angles) > 1:
        refuse("the number of releases without a hand", len(options.angles), "one")
    if options.dialect == "gyro" and "sensor-bias" in effects:
        raise HuskyError("effect 'sensor-bias' is an angle and a rate gyro has none; use sensor-drift.")
    if "discretisation" in effects:
        if others := set(effects) - _STEPPED:
            raise HuskyError(
                f"effect 'discretisation' cannot be made together with {', '.join(sorted(others))}: "
                "the plain step loop holds smooth laws only."
            )
        if options.jitter:
            raise HuskyError("effect 'discretisation' cannot be made with jitter: it moves in steps.")


def _kept(count: int, share: float, rng: np.random.Generator) -> npt.NDArray[np.bool_]:
    kept = np.ones(count, dtype=np.bool_)
    if share > 0:
        # Runs of five on average; each run start is drawn so that the expected share comes out.
        starts = np.flatnonzero(rng.random(count) < -math.log1p(-share) / 5)
        for start, length in zip(starts, rng.geometric(0.2, len(starts)), strict=True):
            kept[start : start + length] = False
        kept[0] = True
    return kept


def _move(
    law: TrueLaw, options: SynthOptions, timestep: float, rng: np.random.Generator
) -> tuple[Array, Array, list[TrueRelease]]:
    """Return true times, shape (n,), motion, shape (n, 3), and releases on the true clock."""
    period = 1.0 / options.rate

    def whole(duration: float) -> float:  # releases fall on samples
        return math.ceil(duration / period - 1e-9) * period

    lead, push, hold = whole(options.lead), whole(options.push), whole(options.hold)
    turn = push + hold + whole(options.duration)
    count = round((lead + turn * len(options.angles)) / period)
    time = np.arange(count, dtype=np.float64) * period
    if options.jitter:
        time = time + options.jitter * period * np.clip(rng.standard_normal(count), -1.5, 1.5)
        time[0] = 0.0
    motion = np.zeros((count, 3))
    condition = Condition.at_rest(law)
    motion[time < lead, 0] = condition.state[0]
    full = options.dialect not in ("angle", "angle-deg")
    releases: list[TrueRelease] = []
    for number, angle in enumerate(options.angles):
        begin = lead + number * turn
        let_go, end = begin + push + hold, begin + turn
        start = (float(condition.state[0]), float(condition.state[1]))
        hand = hand_motion(begin, start, angle, push=push, hold=hold, tremor=options.tremor, rng=rng)
        # Half a nanosecond of slack: the sample at the release belongs to the free decay.
        held = slice(*np.searchsorted(time, (begin - 5e-10, let_go - 5e-10)).tolist())
        free = slice(held.stop, int(np.searchsorted(time, end - 5e-10)))
        motion[held] = hand.sample(time[held])
        condition = _led(law, condition, hand)
        releases.append(
            TrueRelease(
                start=let_go, end=end, angle=float(condition.state[0]), rate=float(condition.state[1])
            )
        )
        if timestep:
            motion[free], condition = _stepped(law, condition, let_go, end, time[free], timestep)
        else:
            times = np.maximum(time[free], let_go)
            motion[free], condition = simulate(law, condition, let_go, end, times, accelerations=full)
    return time, motion, releases


def _led(law: TrueLaw, condition: Condition, hand: HandMotion) -> Condition:
    """Return the condition at the release; what remembers the hand's way is integrated along it."""
    if law.has_memory:
        _, condition = simulate(law, condition, hand.begin, hand.end, np.empty(0), hand)
    roll, rate, _ = hand.sample(np.array([hand.end]))[0].tolist()
    state = condition.state.copy()
    state[:2] = roll, rate
    return Condition(state, condition.modes.regions(law, roll - float(state[2]) - law.rest))


def _stepped(
    law: TrueLaw, condition: Condition, begin: float, end: float, times: Array, timestep: float
) -> tuple[Array, Condition]:
    """Move in MuJoCo's implicitfast steps: rate first, implicit in the damping, then roll with that rate.

    Raises:
        HuskyError: A sample falls between two steps.
    """
    steps = round((end - begin) / timestep)
    if steps > MOST_SAMPLES:
        raise HuskyError(f"a step of {timestep:g} s makes {steps:.3g} steps a release; use a longer one.")
    wanted = (times - begin) / timestep
    index = np.round(wanted).astype(np.int64)
    if np.abs(wanted - index).max(initial=0.0) > 1e-6:
        raise HuskyError(
            f"samples fall between the simulator's steps of {timestep:g} s; use a rate of {1 / timestep:g} Hz "
            "or a whole fraction of it."
        )
    roll, rate = condition.state[:2].tolist()
    path = np.empty((steps + 1, 3))
    modes = Modes()
    for step in range(steps + 1):
        x = roll - law.rest
        torque = law.smooth_torque(x, rate, modes) - law.gravity * math.sin(roll)
        path[step] = roll, rate, torque / law.inertia
        slope = law.damping + 2 * law.quadratic_damping * abs(rate) + 3 * law.cubic_damping * rate**2
        rate += timestep * torque / (law.inertia + timestep * slope)
        roll += timestep * rate
        if not abs(roll) < 2 * math.pi:
            raise HuskyError(
                f"with steps of {timestep:g} s the motion grows without bound; use a shorter one."
            )
    last = np.array([path[-1, 0], path[-1, 1], 0.0, 0.0, 0.0])
    return path[index], Condition(last, modes)
