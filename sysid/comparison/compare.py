"""Measured against simulated: how far off, where, and which torque the model lacks.

Only roll and rate at each release are fitted here; the law is the board's as it stands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sysid.board import Board
from sysid.effects import effect
from sysid.fitting.initial_state import fit_initial_states
from sysid.fitting.records import Bias, Record, make_records
from sysid.joint import JointLaw, simulate
from sysid.joint.torques import effect_torque
from sysid.noise.floor import NoiseFloor, noise_floor
from sysid.quantity import Z95
from sysid.roll import Array, Release

Axis = Literal["time", "amplitude", "velocity", "side", "phase"]

DEFAULT_TOLERANCE = 0.02
"""Error beyond the noise over the RMS roll at which a comparison still passes."""
AT_THE_FLOOR = 1.05
"""Error over noise floor up to which there is nothing to locate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedRelease:
    """One release, measured and simulated."""

    log: str
    number: int
    time: Array
    """Since the release [s], shape (n,)."""
    measured: Array
    """[rad], or [rad/s] where the rate was compared."""
    simulated: Array
    roll: Array
    """Simulated roll [rad], whatever was compared."""
    rate: Array
    """Simulated rate [rad/s]."""
    rmse: float

    @property
    def residual(self) -> Array:
        """Simulated minus measured."""
        return self.simulated - self.measured


@dataclass(frozen=True, slots=True)
class Place:
    """Where a share of the error sits."""

    axis: Axis
    range: tuple[float, float]
    """In the axis' unit: s, rad, rad/s; for side and phase -1 or +1."""
    share: float
    """Share of the squared error beyond the noise."""
    text: str


@dataclass(frozen=True, slots=True)
class MissingTorque:
    """Restoring-force surface of what the model lacks (Masri and Caughey, 1979)."""

    angle: Array
    """Edges of the bins in tilt [rad], shape (a + 1,)."""
    rate: Array
    """Edges of the bins in rate [rad/s], shape (b + 1,)."""
    torque: Array
    """Mean missing torque [N*m], shape (a, b); NaN where there was no data."""
    count: Array
    """Samples in each bin, shape (a, b)."""


@dataclass(frozen=True, slots=True)
class Backbone:
    """Period and damping against amplitude, half swing by half swing."""

    amplitude: Array
    """[rad], shape (m,)."""
    period: Array
    """[s], shape (m,)."""
    damping_ratio: Array
    """[1], shape (m,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """All that a comparison found."""

    board: str
    law: JointLaw
    releases: tuple[ComparedRelease, ...]
    rmse: float
    nrmse: float
    """RMSE over the RMS of the measurement about rest."""
    excess: float
    """The same with the noise taken out: what the model is to blame for."""
    excess_range: tuple[float, float]
    """95 % interval of `excess`, for the noise floor itself is known from few samples."""
    noise: NoiseFloor
    where: tuple[Place, ...]
    """Largest share first."""
    summary: str
    """In words."""
    missing: MissingTorque | None
    measured_backbone: Backbone
    simulated_backbone: Backbone
    tolerance: float
    is_rate: bool

    @property
    def passed(self) -> bool:
        """Whether the error beyond the noise is within the tolerance, as far as the noise is known."""
        return self.excess_range[0] <= self.tolerance

    def verdict(self) -> str:
        """Return the error beyond the noise, with its interval where that decides, and what is allowed."""
        low, high = self.excess_range
        allowed = f"{100 * self.tolerance:.2f} % allowed"
        if high - low < 0.1 * self.tolerance:
            return f"{100 * self.excess:.2f} % beyond the noise, {allowed}"
        return (
            f"{100 * self.excess:.2f} % ({100 * low:.2f} to {100 * high:.2f} %) beyond the noise, whose floor is known to "
            f"±{100 * Z95 * self.noise.relative_std:.0f} %; {allowed}"
        )


def compare(
    releases: Sequence[Release],
    board: Board,
    *,
    law: JointLaw | None = None,
    bias: Bias = "shared",
    use_rate: bool = False,
    tolerance: float = DEFAULT_TOLERANCE,
) -> Comparison:
    """Simulate each release with a board's law and compare.

    Args:
        releases: Measured decays.
        board: The record.
        law: Another law than the record's.
        bias: One sensor zero for all (the record's rest angle holds), or one each.
        use_rate: Compare the measured rate instead of the roll.
        tolerance: For `passed`.

    Raises:
        HuskyError: The law's motion grows without bound.
    """
    noise = noise_floor(releases, rate=use_rate)
    records = make_records(releases, noise.std, rate=use_rate, settled=True)
    law = law or JointLaw.from_board(board)
    residuals, starts = fit_initial_states(law, records, bias=bias)
    compared = tuple(
        _compared(law, record, residual, start)
        for record, residual, start in zip(records, residuals, starts, strict=True)
    )
    everything = np.concatenate(residuals)
    rmse = float(np.sqrt(np.mean(everything**2)))
    motion = np.concatenate([r.signal - (0.0 if use_rate else law.rest_angle) for r in records])
    size = float(np.sqrt(np.mean(motion**2)))
    least, excess, most = (
        float(np.sqrt(max(rmse**2 - std**2, 0.0))) / size for std in (noise.highest, noise.std, noise.lowest)
    )
    where = _where(compared, law, noise)
    return Comparison(
        board=board.name,
        law=law,
        releases=compared,
        rmse=rmse,
        nrmse=rmse / size,
        excess=excess,
        excess_range=(least, most),
        noise=noise,
        where=where,
        summary=_summary(where, rmse, noise.std),
        missing=None if use_rate else missing_torque(compared, law),
        measured_backbone=_backbones(compared, law, [c.measured for c in compared], noise.std),
        simulated_backbone=_backbones(compared, law, [c.simulated for c in compared], 0.0),
        tolerance=tolerance,
        is_rate=use_rate,
    )


def _compared(law: JointLaw, record: Record, residual: Array, start: tuple[float, float]) -> ComparedRelease:
    path = simulate(law, record.time, *start, hold=max(record.release.hold, 0.0))
    return ComparedRelease(
        log=record.release.log,
        number=record.release.number,
        time=record.time,
        measured=record.signal,
        simulated=record.signal + residual,
        roll=path.roll,
        rate=path.rate,
        rmse=float(np.sqrt(np.mean(residual**2))),
    )


def _where(compared: Sequence[ComparedRelease], law: JointLaw, noise: NoiseFloor) -> tuple[Place, ...]:
    """Divide the squared error beyond the noise along five axes and return the parts, largest first."""
    error = np.concatenate([c.residual**2 - noise.std**2 for c in compared])
    total = float(error.sum())
    least = max(AT_THE_FLOOR * noise.std, noise.highest)
    if total <= 0 or total < (least**2 - noise.std**2) * len(error):
        return ()
    tilt = np.concatenate([c.roll - law.rest_angle for c in compared])
    rate = np.concatenate([c.rate for c in compared])
    time = np.concatenate([c.time for c in compared])
    swing = np.hypot(tilt, rate / law.frequency)
    places: list[Place] = []
    axes: tuple[tuple[Axis, Array], ...] = (("time", time), ("amplitude", swing), ("velocity", np.abs(rate)))
    for axis, values in axes:
        top = float(values.max())
        for low, high in ((0.0, 0.25), (0.25, 0.5), (0.5, 1.0)):
            inside = (values >= low * top) & (values < high * top if high < 1 else values <= top)
            text = _range_text(axis, low * top, high * top, last=high == 1.0)
            places.append(Place(axis, (low * top, high * top), float(error[inside].sum()) / total, text))
    for sign, text in ((1.0, "with the right edge down"), (-1.0, "with the left edge down")):
        places.append(Place("side", (sign, sign), float(error[tilt * sign > 0].sum()) / total, text))
    for sign, text in ((1.0, "while slowing down"), (-1.0, "while speeding up")):
        share = float(error[tilt * rate * sign > 0].sum()) / total
        places.append(Place("phase", (sign, sign), share, text))
    return tuple(sorted(places, key=lambda p: -p.share))


def _range_text(axis: str, low: float, high: float, *, last: bool) -> str:
    if axis == "time":
        return (
            f"after {low:.2g} s"
            if last
            else f"between {low:.2g} and {high:.2g} s"
            if low
            else f"before {high:.2g} s"
        )
    scale, unit, what = (
        (float(np.degrees(1.0)), "°", "at amplitudes") if axis == "amplitude" else (1.0, " rad/s", "at rates")
    )
    low, high = scale * low, scale * high
    if last:
        return f"{what} above {low:.2g}{unit}"
    return f"{what} between {low:.2g} and {high:.2g}{unit}" if low else f"{what} below {high:.2g}{unit}"


_FRACTIONS = (
    (0.95, "nearly all"), (0.85, "nine tenths"), (0.72, "three quarters"), (0.62, "two thirds"),
    (0.45, "half"), (0.3, "a third"), (0.0, "part"),
)  # fmt: skip


def _summary(where: Sequence[Place], rmse: float, noise: float) -> str:
    """Say where the error sits, e.g. 'two thirds of the error is at amplitudes below 3°, while slowing down'."""
    if not where:
        return f"The error is the sensor's noise ({rmse / noise:.2f} times the floor): there is nothing to locate."
    best: dict[str, Place] = {}
    for place in where:
        best.setdefault(place.axis, place)
    main = max((best["amplitude"], best["time"]), key=lambda p: p.share)
    words = [main.text]
    for axis in ("velocity", "phase", "side"):
        if best[axis].share > 0.65:
            words.append(best[axis].text)
    if best["side"].share <= 0.65:
        words.append("on both sides")
    fraction = next(name for least, name in _FRACTIONS if main.share >= least)
    return f"{fraction.capitalize()} of the error is {', '.join(words)}."


def missing_torque(
    compared: Sequence[ComparedRelease], law: JointLaw, *, bins: tuple[int, int] = (15, 15)
) -> MissingTorque | None:
    """Return the torque that measured and simulated motion differ by, averaged over tilt and rate.

    The measured roll is differentiated by a local quartic over a sixth of a period. Both motions go through
    the same filter and law, so that what the filter does to a correct model cancels.

    Args:
        compared: Releases.
        law: The law that was simulated.
        bins: Number of bins in tilt and rate.

    Returns:
        The surface, or None where the sampling is too slow to differentiate.
    """
    tilts: list[Array] = []
    rates: list[Array] = []
    torques: list[Array] = []
    for release in compared:
        measured = _derivatives(release.time, release.measured, law)
        simulated = _derivatives(release.time, release.simulated, law)
        if measured is None or simulated is None:
            continue
        demanded = _torque_left(law, release.time, measured) - _torque_left(law, release.time, simulated)
        inner = slice(3, -3)
        tilts.append(measured[0][inner] - law.rest_angle)
        rates.append(measured[1][inner])
        torques.append(demanded[inner])
    if not tilts:
        return None
    tilt, rate, torque = (np.concatenate(part) for part in (tilts, rates, torques))
    a = np.linspace(-1, 1, bins[0] + 1) * float(np.abs(tilt).max()) * 1.001
    b = np.linspace(-1, 1, bins[1] + 1) * float(np.abs(rate).max()) * 1.001
    count, _, _ = np.histogram2d(tilt, rate, bins=(a, b))
    total, _, _ = np.histogram2d(tilt, rate, bins=(a, b), weights=torque)
    with np.errstate(invalid="ignore"):
        mean = np.where(count > 2, total / np.maximum(count, 1), np.nan)
    return MissingTorque(a, b, mean, count)


def _derivatives(time: Array, roll: Array, law: JointLaw) -> tuple[Array, Array, Array] | None:
    """Return smoothed roll, rate and acceleration (Savitzky–Golay), or None if too few samples a swing."""
    from scipy.signal import savgol_filter

    step = float(np.median(np.diff(time)))
    window = int(2 * np.pi / law.frequency / 6 / step) | 1
    if window < 7 or window > len(roll) // 2:
        return None
    roll0, rate, acceleration = (
        np.asarray(savgol_filter(roll, window, 4, deriv=order, delta=step)) for order in range(3)
    )
    return roll0, rate, acceleration


def _torque_left(law: JointLaw, time: Array, motion: tuple[Array, Array, Array]) -> Array:
    """Return I φ̈ less the law's torques without memory [N*m]."""
    roll, rate, acceleration = motion
    effects: Mapping[str, tuple[float, ...]] = dict(law.effects)
    ratio = effects.get("inertia", (1.0,))[0]
    left = ratio * law.inertia * acceleration + law.stiffness * (roll - law.rest_angle) + law.damping * rate
    for name in effects:
        if effect(name).role == "torque" and not effect(name).states:
            left = left - effect_torque(law, name, time, roll, rate)
    return left


def _backbones(
    compared: Sequence[ComparedRelease], law: JointLaw, signals: Sequence[Array], noise: float
) -> Backbone:
    parts = [
        _backbone(release.time, signal - law.rest_angle, law, noise)
        for release, signal in zip(compared, signals, strict=True)
    ]
    amplitude, period, damping = (np.concatenate([part[i] for part in parts]) for i in range(3))
    order = np.argsort(amplitude)
    return Backbone(amplitude[order], period[order], damping[order])


def _backbone(time: Array, tilt: Array, law: JointLaw, noise: float) -> tuple[Array, Array, Array]:
    """Return amplitude, period and damping ratio of each half swing between turning points."""
    from scipy.signal import find_peaks

    smooth = _derivatives(time, tilt, law)
    if smooth is None:
        return np.empty(0), np.empty(0), np.empty(0)
    y = smooth[0]
    least = max(6 * noise, 0.01 * float(np.abs(tilt).max()))
    gap = max(1, int(0.3 * 2 * np.pi / law.frequency / float(np.median(np.diff(time)))))
    peaks = np.sort(np.concatenate([find_peaks(sign * y, height=least, distance=gap)[0] for sign in (1, -1)]))
    if len(peaks) < 2:
        return np.empty(0), np.empty(0), np.empty(0)
    size = np.abs(y[peaks])
    shrink = np.log(size[:-1] / size[1:])
    usable = (np.diff(np.sign(y[peaks])) != 0) & (shrink > 0)
    amplitude = np.sqrt(size[:-1] * size[1:])[usable]
    period = 2 * np.diff(time[peaks])[usable]
    damping = (shrink / np.hypot(np.pi, shrink))[usable]
    return amplitude, period, damping
