"""`husky-sysid synth`: make a synthetic log with a known truth."""

import math
import shlex
import sys
from typing import Annotated

from cyclopts import Parameter

from sysid.cli.console import BoardName, Common, Output, Printer
from sysid.errors import SysidError
from sysid.synth import SynthOptions, synthesise
from sysid.synth.effects import complete_effects, parse_effect
from sysid.synth.sensors import Dialect, Sensor

Texts = Annotated[tuple[str, ...], Parameter(negative="", show_default=False)]
LeverArm = Annotated[tuple[float, float, float], Parameter(negative="", allow_leading_hyphen=True)]
DEFAULT_ANGLE = 0.87
"""First release angle as a share of the board's range: 10 degrees of 0.2 rad."""


def synth(
    *,
    board: BoardName,
    output: Output,
    effect: Annotated[Texts, Parameter(name=["--effect", "-e"])] = (),
    release_angle: Annotated[Texts, Parameter(allow_leading_hyphen=True)] = (),
    releases: int | None = None,
    rate: float | None = None,
    duration: float = 2.0,
    hold: float = 0.6,
    noise_deg: float = 0.1,
    quantisation_deg: float = 0.0,
    jitter: float = 0.0,
    dropout: float = 0.0,
    seed: int = 0,
    dialect: Dialect = "angle",
    lever_arm: LeverArm = (0.1, 0.03, 0.05),
    gyro_bias: float = 0.01,
    gyro_noise: float = 0.003,
    accelerometer_noise: float = 0.03,
    hand: bool = True,
    common: Common = Common(),
) -> int:
    """Make a synthetic log with a known truth, for trying the tool out.

    The truth is written beside the log, as LOG.truth.json.

    Args:
        board: The board that is recorded.
        output: The log to write: .csv, or .zip for the dialects phyphox and sensor-logger.
        effect: A hidden effect, NAME=V[,V...] in SI units, e.g. coulomb=0.1; may be repeated.
        release_angle: Roll at a release, e.g. 10, 10deg or 0.17rad (degrees without a unit), right edge down
            positive; may be repeated, one release each.
        releases: Number of releases where no angles are given: alternating sides, each smaller than the one
            before.
        rate: Samples per second; 1000, or what the simulator's step gives with the effect 'discretisation'.
        duration: Time left to each free decay [s].
        hold: Time for which the deck is held before each release [s].
        noise_deg: White noise of an angle sample [degrees].
        quantisation_deg: Step of an angle sensor [degrees].
        jitter: Standard deviation of the sampling instants, in sampling periods.
        dropout: Share of samples that are missing.
        seed: Seed of everything random; the same seed makes the same file.
        dialect: How the log is written.
        lever_arm: Where an IMU sits, from the tilt axis: forward, left, up [m].
        gyro_bias: Offset of a gyro [rad/s].
        gyro_noise: White noise of a gyro sample [rad/s].
        accelerometer_noise: White noise of an accelerometer sample [m/s^2].
        hand: Keep rest and hand in the log; without, it starts at the only release.
    """
    for option, value in (("--noise-deg", noise_deg), ("--quantisation-deg", quantisation_deg)):
        if not 0 <= value < math.inf:
            raise SysidError(f"{option} {value:g}: expected degrees, 0 or more.")
    printer = Printer(common)
    record = common.space.load_board(board)
    limit = record.tilt["range"].value
    effects = complete_effects(dict(parse_effect(text) for text in effect))
    if len(effects) < len(effect):
        raise SysidError("an effect is given twice; each may be given once.")
    angles = _angles(release_angle, releases, limit)
    if beyond := [a for a in angles if abs(a) > limit]:
        printer.warn(
            f"release at {math.degrees(beyond[0]):.3g} degrees is beyond the range of the board record "
            f"(±{math.degrees(limit):.3g} degrees); the synthetic board has no stop there unless you add end-stop."
        )
    if rate is None:
        rate = 1 / effects["discretisation"][0] if "discretisation" in effects else 1000.0
    sensor = Sensor(
        noise=math.radians(noise_deg), quantisation=math.radians(quantisation_deg), lever_arm=lever_arm,
        gyro_bias=gyro_bias, gyro_noise=gyro_noise, accelerometer_noise=accelerometer_noise,
    )  # fmt: skip
    options = SynthOptions(
        angles=angles, rate=rate, duration=duration, hold=hold, jitter=jitter,
        dropout=dropout, seed=seed, dialect=dialect, hand=hand, sensor=sensor,
    )  # fmt: skip
    log = synthesise(record, effects, options)
    path, truth = log.save(output, command=shlex.join(["husky-sysid", *sys.argv[1:]]))
    printer.say(
        f"{path} · {len(log.time)} samples · {options.rate:g} Hz · {log.time[-1]:.1f} s · {dialect} · {board}"
    )
    for number, release in enumerate(log.releases, start=1):
        printer.say(
            f"  release {number}: t = {release.start:.3f} s, {math.degrees(release.angle):+.2f} degrees"
        )
    hidden = ", ".join(
        f"{name} ({', '.join(f'{v:g}' for v in values)})" for name, values in log.effects.items()
    )
    printer.say(f"  hidden: {hidden or 'nothing'}")
    printer.say(f"truth: {truth}")
    printer.result({"log": str(path), **log.truth()})
    return 0


def _angles(given: tuple[str, ...], count: int | None, limit: float) -> tuple[float, ...]:
    if given and count is not None and count != len(given):
        raise SysidError(f"--releases {count} and {len(given)} release angles; give one or the other.")
    if given:
        return tuple(map(_angle, given))
    if count is not None and count < 1:
        raise SysidError(f"--releases is {count}; expected at least 1.")
    sizes = [DEFAULT_ANGLE * limit * max(0.4, 1 - 0.12 * number) for number in range(count or 1)]
    return tuple(size * (-1) ** number for number, size in enumerate(sizes))


def _angle(text: str) -> float:
    unit = next((unit for unit in ("degrees", "deg", "°", "rad") if text.endswith(unit)), "")
    try:
        return float(text.removesuffix(unit)) * (1 if unit == "rad" else math.radians(1))
    except ValueError:
        raise SysidError(f"release angle '{text}' is not an angle; write 10, 10deg or 0.17rad.") from None
