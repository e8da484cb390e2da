"""A synthetic log: options of the recording, readings, and truth."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.effects import effect
from sysid.errors import SysidError
from sysid.files import write_json
from sysid.quantity import slide_unit
from sysid.roll import Array, Roll
from sysid.synth.law import TrueLaw
from sysid.synth.sensors import Dialect, Sensor, write_log


@dataclass(frozen=True, slots=True, kw_only=True)
class SynthOptions:
    """Options of a synthetic recording."""

    angles: tuple[float, ...] = (math.radians(10.0),)
    """Roll at each release [rad], right edge down positive."""
    rate: float = 1000.0
    """Sampling rate [Hz]."""
    duration: float = 2.0
    """Time left to each free decay [s]."""
    hold: float = 0.6
    """Time for which the deck is held before each release [s]."""
    push: float = 0.5
    """Time in which the hand pushes the deck over [s]."""
    lead: float = 0.6
    """Untouched rest at the start of the log [s]."""
    tremor: float = math.radians(0.03)
    """Root mean square tremor of the holding hand [rad]."""
    hand: bool = True
    """Keep rest and hand in the log; without, a log of one release starts at the release."""
    jitter: float = 0.0
    """Standard deviation of the sampling instants, in sampling periods; the stamps are true."""
    dropout: float = 0.0
    """Share of samples that are missing, lost in runs of about five."""
    seed: int = 0
    dialect: Dialect = "angle"
    sensor: Sensor = field(default_factory=lambda: Sensor(noise=math.radians(0.1)))


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueRelease:
    """Truth of one release, on the log's clock."""

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
    """Readings, shape (n, channels) (see `measure`)."""
    true_motion: Array
    """True roll [rad], rate [rad/s] and acceleration [rad/s^2] (0 if no sensor needs it), shape (n, 3)."""
    releases: tuple[TrueRelease, ...]

    def to_roll(self, name: str = "synthetic") -> Roll:
        """Return an angle log as the reader would.

        Raises:
            SysidError: The log holds no angle.
        """
        if self.channels.shape[1] != 1 or self.options.dialect == "gyro":
            raise SysidError(f"a log of dialect '{self.options.dialect}' holds no angle; read it as a file.")
        roll = self.channels[:, 0]
        return Roll(
            log=name, time=self.time, roll=roll, std=np.full(len(roll), self.angle_std), origin="angle"
        )

    @property
    def angle_std(self) -> float:
        """Standard deviation of one angle sample [rad]: white noise and rounding."""
        sensor = self.options.sensor
        return math.hypot(sensor.noise, sensor.quantisation / math.sqrt(12))

    def truth(self) -> dict[str, Any]:
        """Return the truth of the log as JSON-ready data."""
        law, slides = self.law, self.options.dialect == "position"
        unit, position = (slide_unit, "position_m") if slides else (str, "angle_rad")
        parameters = {
            "inertia": {"value": law.inertia, "unit": unit("kg*m^2")},
            "stiffness": {"value": law.stiffness, "unit": unit("N*m/rad")},
            "damping": {"value": law.damping, "unit": unit("N*m*s/rad")},
            "rest_angle": {"value": law.rest, "unit": unit("rad")},
        }
        effects: list[dict[str, Any]] = []
        for name, values in self.effects.items():
            pairs = zip(effect(name).parameters, values, strict=True)
            own = {one.name: {"value": value, "unit": unit(one.unit)} for one, value in pairs}
            effects.append({"name": name, "parameters": own})
        options = asdict(self.options)
        seed, angles = options.pop("seed"), options.pop("angles")
        sensor = options.pop("sensor")
        return {
            "synthetic": True,
            "board": self.board,
            "parameters": parameters,
            "effects": effects,
            "releases": [
                {
                    "t_start_s": r.start,
                    "t_end_s": r.end,
                    position: r.angle,
                    ("speed_m_s" if slides else "rate_rad_s"): r.rate,
                }
                for r in self.releases
            ],
            "seed": seed,
            "samples": len(self.time),
            "options": {**options, "angles": list(angles)},
            "sensor": sensor,
        }

    def save(self, path: Path, command: str = "") -> tuple[Path, Path]:
        """Write the log and, beside it, the truth; return both paths.

        Raises:
            SysidError: The name does not go with the dialect, or the folder cannot be written to.
        """
        truth = path.with_suffix(".truth.json")
        write_log(path, self.time, self.channels, self.options.dialect)
        write_json(truth, {**self.truth(), "command": command} if command else self.truth())
        return path, truth
