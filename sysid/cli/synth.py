"""`husky-sysid synth`: make a synthetic log with a known truth."""

import math
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from cyclopts import Parameter

from sysid.board import Board
from sysid.cli.console import Common, Output, Printer, Texts
from sysid.cli.subject import Subject
from sysid.effects import effect as known_effect
from sysid.errors import SysidError
from sysid.synth import SynthOptions, synthesise
from sysid.synth.effects import complete_effects, parse_effect, true_law
from sysid.synth.sensors import Dialect, Sensor
from sysid.text import Display, display

DEFAULT_ANGLE = 0.87
"""First release angle as a share of the joint's range: 10 degrees of 0.2 rad."""
WIDEST = math.radians(45)
"""Largest first release angle [rad]."""


@Parameter(name="*", group="Recording")
@dataclass(frozen=True, kw_only=True)
class RecordingArguments:
    """The recording: time, samples, file."""

    rate: float | None = None
    """Samples per second; 1000, or the rate of the simulator's steps with the effect 'discretisation'."""
    duration: float = 2.0
    """Time of each free decay [s]."""
    jitter: float = 0.0
    """Standard deviation of the sampling instants, in sampling periods."""
    dropout: float = 0.0
    """Share of samples that are missing."""
    seed: int = 0
    """Seed of everything random; the same seed makes the same file."""
    dialect: Dialect | None = None
    """Channels and format of the log: angle; position for a slide."""
    hand: Annotated[bool, Parameter(negative="--no-hand")] = True
    """Keep rest and hand in the log; without them, it starts at the only release."""


@Parameter(name="*", group="Sensor")
@dataclass(frozen=True, kw_only=True)
class SensorArguments:
    """The sensor."""

    noise: str | None = None
    """White noise of a sample of the angle, in degrees or with a unit (0.1; 0.002rad); of a slide in mm."""
    quantisation: str = "0"
    """Step of the sensor, in the same units."""
    lever_arm: Annotated[tuple[float, float, float], Parameter(allow_leading_hyphen=True)] = (0.1, 0.03, 0.05)
    """Place of an IMU, from the tilt axis: forward, left, up [m]."""

    def sensor(self, show: Display) -> Sensor:
        """Return the sensor of a joint with that display; its noise is 0.1 degrees or mm if left out."""
        noise, step = (
            _position("0.1" if text is None else text, show) for text in (self.noise, self.quantisation)
        )
        if min(noise, step) < 0:
            raise SysidError(
                f"--noise {self.noise} --quantisation {self.quantisation}: must not be negative."
            )
        return Sensor(noise=noise, quantisation=step, lever_arm=self.lever_arm)


def synth(
    *,
    subject: Subject = Subject(),
    output: Output,
    effect: Texts = (),
    release_angle: Annotated[Texts, Parameter(allow_leading_hyphen=True)] = (),
    releases: int | None = None,
    recording: RecordingArguments = RecordingArguments(),
    sensor: SensorArguments = SensorArguments(),
    common: Common = Common(),
) -> None:
    """Make a synthetic log with a known truth, to try the tool.

    Args:
        output: The log to write: .csv, or .zip for the dialects phyphox and sensor-logger.
        effect: A hidden effect, NAME=V[,V...] in SI units, e.g. coulomb=0.1; may be repeated.
        release_angle: Roll at a release, e.g. 10, 10deg or 0.17rad (degrees without a unit), right edge down positive. For a
            slide its position, e.g. 20mm or 0.02m (mm without a unit). May be repeated, one release each.
        releases: Number of releases without given angles: alternating sides, each smaller than the one before.
    """
    if output.is_file() and not output.with_suffix(".truth.json").exists():
        raise SysidError(
            f"--output {output}: exists, and is not a synthetic log (it has no truth file); it would be lost. Choose another name."
        )
    printer = Printer(common)
    record = subject.load(common, printer)
    show = display(is_rate=False, slides=record.slides)
    effects = complete_effects(dict(parse_effect(text) for text in effect))
    if len(effects) < len(effect):
        raise SysidError("an effect is given twice; each may be given once.")
    angles = _angles_of(record, effects, release_angle, releases, show, printer)
    usual = 1 / effects["discretisation"][0] if "discretisation" in effects else 1000.0
    options = SynthOptions(
        angles=angles, rate=usual if recording.rate is None else recording.rate, duration=recording.duration,
        jitter=recording.jitter, dropout=recording.dropout, seed=recording.seed,
        dialect=recording.dialect or ("position" if record.slides else "angle"), hand=recording.hand,
        sensor=sensor.sensor(show),
    )  # fmt: skip
    log = synthesise(record, effects, options)
    path, truth = log.save(output, command=shlex.join(["husky-sysid", *sys.argv[1:]]))
    printer.say(
        f"{path} · {len(log.time)} samples · {options.rate:g} Hz · {log.time[-1]:.1f} s · {options.dialect} · {record.name}"
    )
    for number, release in enumerate(log.releases, start=1):
        printer.say(
            f"  release {number}: t = {release.start:.3f} s, {show.scale * release.angle:+.2f}{show.unit}"
        )
    hidden = ", ".join(
        f"{name} ({', '.join(f'{v:g}' for v in values)})"
        for name, values in log.effects.items()
        if not known_effect(name).is_known  # without the weight of a model
    )
    printer.say(f"  hidden: {hidden or 'nothing'}")
    printer.say(f"truth: {truth}")
    printer.result({"log": str(path), **log.truth()})


def _angles_of(
    record: Board, effects: Mapping[str, Sequence[float]], given: Sequence[str], count: int | None, show: Display,
    printer: Printer,
) -> tuple[float, ...]:  # fmt: skip
    """Return the release angles or positions [rad or m]."""
    own = {part.name: [q.value for q in part.parameters.values()] for part in record.effects}
    law, limit = true_law(record, {**own, **effects}), record.tilt["range"].value
    rest = law.equilibrium() if record.model else 0.0
    if given and count is not None and count != len(given):
        raise SysidError(f"--releases {count} and {len(given)} release angles; give one or the other.")
    if count is not None and count < 1:
        raise SysidError(f"--releases is {count}; expected at least 1.")
    first = min(DEFAULT_ANGLE * limit, WIDEST)
    usual = (first * max(0.4, 1 - 0.12 * number) * (-1) ** number for number in range(count or 1))
    angles = tuple(_position(text, show) for text in given) or tuple(rest + angle for angle in usual)
    if not any(law.pull(angle) for angle in angles):
        raise SysidError(
            f"nothing pulls '{record.name}' back to its rest, neither a spring nor a weight: a released joint stays where it is. "
            "Give it a stiffness, or choose another joint."
        )
    if beyond := [a for a in angles if abs(a - rest) > limit]:
        reach = f"±{show(limit, 3)}" if rest == 0 else f"{show(rest - limit, 3)} to {show(rest + limit, 3)}"
        printer.warn(
            f"release at {show(beyond[0], 3)} is beyond the range of the record ({reach}); "
            "the synthetic joint has no stop there unless you add end-stop."
        )
    return angles


def _position(text: str, show: Display) -> float:
    """Return a position of the joint [rad or m], typed in degrees or mm, or with a unit."""
    slides = show.name == "position"
    units = {"mm": 1e-3, "m": 1.0} if slides else {"degrees": 0.0, "deg": 0.0, "°": 0.0, "rad": 1.0}
    unit = next((unit for unit in units if text.endswith(unit)), "")
    try:
        value = float(text.removesuffix(unit)) * (units.get(unit) or 1 / show.scale)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        example = "a position; write 20, 20mm or 0.02m" if slides else "an angle; write 10, 10deg or 0.17rad"
        raise SysidError(f"'{text}' is not {example}.")
    return value
