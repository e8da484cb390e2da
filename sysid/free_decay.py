"""Free decay: one linear law fitted to whole releases, and a test of that law.

`decay`, `live`, `batch`, the library and the report all show the result of `fit_decay`, a `FreeDecay`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.board import Board
from sysid.decay import report as decay_report
from sysid.decay.coast_down import fit_coast_down, spins_down
from sysid.decay.doubt import ABOVE_NOISE, Judgement, judged, sensor_noise
from sysid.decay.hand import without_hand
from sysid.decay.linear_fit import TraceFit, fit_traces, project
from sysid.decay.numbers import DecayNumbers as DecayNumbers
from sysid.decay.numbers import decay_from_peaks as decay_from_peaks
from sysid.decay.numbers import decay_numbers, without
from sysid.decay.peaks import Peak, find_peaks
from sysid.decay.peaks import log_decrement_two_peaks as log_decrement_two_peaks
from sysid.decay.plausibility import amplitude_warnings, period_warnings, record_warnings
from sysid.decay.trace import Trace
from sysid.errors import SysidError
from sysid.noise.floor import NoiseFloor
from sysid.noise.sensor import BEST_SENSOR
from sysid.quantity import SURE, Z95, Quantity, t95
from sysid.recording import Data, Recording, reading_warnings, unpack
from sysid.roll import Release, shown
from sysid.shown import Shown
from sysid.text import WIDTH, Display, count, display, quantity_frame

if TYPE_CHECKING:
    import pandas as pd

PENDULUM = 0.3
"""Amplitude from which a pendulum's law is fitted too [rad]: its sine is then 1.5 % below the angle, and its period 0.6 % longer."""
SMALL_SHARE = 0.1
"""Least share of free decay in a log without a warning."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class FreeDecay(Shown):
    """Result of `fit_decay`: stiffness, damping and frequencies of a joint, from its free decays."""

    releases: tuple[Release, ...]
    """The free decays; a gyro's roll without its drift."""
    numbers: DecayNumbers
    """From the whole traces."""
    trace: TraceFit
    """The fit."""
    judgement: Judgement
    """Whether a linear law holds."""
    peaks: tuple[tuple[Peak, ...], ...]
    """Turning points of each release above the noise."""
    two_peaks: Quantity | None
    """Classic δ of two peaks, from the first release with two."""
    rest_angles: tuple[Quantity, ...]
    """Rest angle of each release [rad]."""
    floor: NoiseFloor
    """Sensor noise of the fitted signal."""
    others: Mapping[str, Quantity] = field(default_factory=dict[str, Quantity])
    """Numbers of a joint that does not oscillate: stiffness_over_damping, or damping_over_inertia and friction_over_inertia."""
    warnings: tuple[str, ...] = ()
    """Problems of the logs and of the decay, and contradictions to the board's record."""
    recordings: tuple[Recording, ...] = ()
    """The logs; empty if only releases were given."""
    board: str | None = None
    """Name of the board, if its record was given."""

    @property
    def slides(self) -> bool:
        """Whether the joint is a slide."""
        return self.numbers.inertia.unit == "kg"

    @property
    def position(self) -> Display:
        """Display of the roll, or of the position of a slide."""
        return display(is_rate=False, slides=self.slides)

    @property
    def show(self) -> Display:
        """Display of the fitted signal."""
        return self.position if self.trace.signal == "roll" else display(is_rate=True, slides=self.slides)

    @property
    def has_inertia(self) -> bool:
        """Whether the roll inertia was given; k and d need it."""
        return math.isfinite(self.numbers.inertia.value)

    @property
    def linear(self) -> bool:
        """Whether a linear law holds, and the log could have shown otherwise."""
        return self.judgement.status == "linear"

    @property
    def status(self) -> str:
        """Whether the decay is 'linear', 'not linear', or the log 'cannot tell'."""
        return self.judgement.status

    def brief(self) -> str:
        """Return the law, the quantities and whether the decay is linear."""
        numbers = (
            f"{name} {quantity}" for name, quantity in self.numbers.items() if math.isfinite(quantity.value)
        )
        of = f" of {self.board}" if self.board else ""
        lines = [
            f"FreeDecay{of}: {count(len(self.releases), 'release')}, {self.status}",
            f"  {decay_report.equation(self)}",
            *(f"  {line}" for line in numbers),
            f"  {decay_report.verdict(self)}",
        ]
        return "\n".join(lines)

    def report(self, width: int = WIDTH) -> str:
        """Return the text of `husky-sysid decay`, in tables of at most `width` characters."""
        return decay_report.report(self, width)

    def to_json(self) -> dict[str, Any]:
        """Return the content of `husky-sysid decay --json`: SI, radians, each quantity with its 95 % interval."""
        return decay_report.to_json(self)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return one row a quantity: value, std, low and high end of the 95 % interval, unit, how."""
        return quantity_frame(dict(self.numbers.items()) | dict(self.others))


NO_INERTIA = Quantity(math.nan, math.nan, "kg*m^2", "not given")
"""A free decay fixes k/I and d/I only."""


def fit_decay(data: Data, inertia: Quantity | None = None, *, board: Board | None = None) -> FreeDecay:
    """Identify a linear tilt joint from its free decays.

    Args:
        data: Free decays of one board: a recording, several, or releases.
        inertia: Roll inertia about the tilt axis [kg*m^2], with its uncertainty; that of the board if left out. Without
            both, k and d are NaN.
        board: The record to compare with the decay.

    Raises:
        SysidError: The releases are too short, driven, or not a decay.
    """
    recordings, releases, weak = unpack(data)
    if inertia is None:
        slides = all(release.slides for release in releases)
        inertia = (
            board.inertia if board is not None else replace(NO_INERTIA, unit="kg" if slides else "kg*m^2")
        )
    turns = spins_down(releases)
    odd = [] if turns else amplitude_warnings(releases, board)
    decay = _spun_down(releases, inertia) if turns else _fitted(releases, inertia)
    doubts = [*odd, *_warnings(decay)]
    if board is not None and decay.trace.law != "none":
        log = ", ".join(dict.fromkeys(release.log for release in releases))
        one_sided = len({release.side for release in releases}) == 1
        doubts += period_warnings(decay.trace.omega_n, board, log=log)
        doubts += record_warnings(decay.numbers, board, log=log, linear=decay.linear, one_sided=one_sided)
    shares = (
        f"{one.path}: {100 * used:.1f} % of the log is free decay. Is a release missing? Mark it with --release"
        for one in recordings
        if (used := one.used) < SMALL_SHARE
    )
    return replace(
        decay,
        warnings=(*reading_warnings(recordings), *shares, *weak, *doubts),
        recordings=recordings,
        board=None if board is None else board.name,
    )


def _fitted(releases: Sequence[Release], inertia: Quantity) -> FreeDecay:
    """Fit one law with a restoring torque to all releases together."""
    trace = _law_of(releases)
    _refuse_nonsense(releases, trace)
    decay = _judged(releases, trace, inertia)
    free, fit = without_hand(releases, trace, _law_of)
    if fit is trace:
        return decay
    other = _judged(free, fit, inertia)
    # A hand that leaves another law may be that law.
    to_noise = other.judgement.over_noise < ABOVE_NOISE and (other.linear or decay.linear)
    return other if to_noise else decay


def _judged(releases: Sequence[Release], trace: TraceFit, inertia: Quantity) -> FreeDecay:
    """Return the result of a fit."""
    floor = sensor_noise(trace)
    steady, rests, noise = _rest_angles(releases, trace, floor)
    # The sensor's zero drifts between releases.
    zeros = [float(np.median(one.std)) if one.zero == "drifting" else 0.0 for one in releases]
    levels = [replace(one, std=math.hypot(one.std, zero)) for one, zero in zip(rests, zeros, strict=True)]
    trace, judgement = judged(trace, floor, steady, levels if trace.signal == "roll" else [])
    numbers, others = _numbers(trace, inertia, f"whole trace of {count(len(releases), 'release')}")
    peaks = [
        find_peaks(release, rest.value, trace.omega_n, numbers.omega_d.value, noise)
        if trace.damping_ratio < 1
        else []
        for release, rest in zip(steady, rests, strict=True)
    ]
    pairs = (log_decrement_two_peaks(group, rest.std) for group, rest in zip(peaks, rests, strict=True))
    return FreeDecay(
        releases=tuple(steady),
        numbers=numbers,
        trace=trace,
        judgement=judgement,
        peaks=tuple(tuple(group) for group in peaks),
        two_peaks=next((delta for delta in pairs if delta is not None), None),
        rest_angles=tuple(rests),
        floor=floor,
        others=others,
    )


def _law_of(releases: Sequence[Release]) -> TraceFit:
    """Return the fit of a spring, or of a pendulum if the joint swings wide and the residual is then smaller."""
    trace = fit_traces(releases)
    if max(release.amplitude for release in releases) <= PENDULUM or releases[0].slides:
        return trace
    return min(trace, fit_traces(releases, "pendulum", near=trace), key=lambda fit: fit.noise)


def _spun_down(releases: Sequence[Release], inertia: Quantity) -> FreeDecay:
    """Fit a joint without a spring."""
    trace, found = fit_coast_down(releases)
    floor = sensor_noise(trace)
    ratio, rate = trace.noise / floor.std, found["damping_over_inertia"]
    reason = "damping and dry friction leave a shape, see the picture" if ratio > ABOVE_NOISE else ""
    numbers = decay_numbers(1.0, 1.0, np.zeros((2, 2)), inertia)
    names = [name for name, _ in numbers.items() if name not in ("inertia", "damping")]
    damping = rate.value * inertia.value
    std = damping * math.hypot(rate.std / rate.value, inertia.std / inertia.value)
    of_joint = Quantity(damping, std, numbers.damping.unit, "coast-down")
    return FreeDecay(
        releases=tuple(releases),
        numbers=replace(without(numbers, names, "no restoring torque"), damping=of_joint),
        trace=trace,
        judgement=Judgement("not linear" if reason else "linear", reason, ratio, 1.0, ()),
        peaks=tuple(() for _ in releases),
        two_peaks=None,
        rest_angles=tuple(Quantity(one.rest, math.nan, "rad", "where it stopped") for one in releases),
        floor=floor,
        others=found,
    )


def _numbers(trace: TraceFit, inertia: Quantity, method: str) -> tuple[DecayNumbers, dict[str, Quantity]]:
    """Return the numbers of a fit, and k/d if the joint is overdamped."""
    omega, zeta, tau = trace.omega_n, trace.damping_ratio, float(trace.poles[1])
    jacobian = np.array([[-omega / 2, 0.0], [-zeta / 2, omega / 2]])
    freedom = trace.degrees_of_freedom
    covariance = np.asarray(jacobian @ trace.covariance @ jacobian.T, dtype=np.float64)
    numbers = decay_numbers(omega, zeta, covariance, inertia, degrees_of_freedom=freedom, method=method)
    if zeta < 1:
        return numbers, {}
    std = math.sqrt(trace.covariance[1, 1]) / tau**2
    half = t95(freedom) * std
    others = {
        "stiffness_over_damping": Quantity(1 / tau, std, "1/s", method, (1 / tau - half, 1 / tau + half))
    }
    if _fixes_stiffness(trace):
        return numbers, others
    open_ones = ("omega_n", "damping_ratio", "stiffness", "damping")
    return without(numbers, open_ones, "not fixed: the fast start was not seen"), others


def _fixes_stiffness(trace: TraceFit) -> bool:
    """Whether the 95 % interval of k, which has the relative deviation of m, excludes zero."""
    return Z95 * math.sqrt(trace.covariance[0, 0]) < 1


def _refuse_nonsense(releases: Sequence[Release], trace: TraceFit) -> None:
    """Refuse releases that are not a decay, driven, or too short."""
    log = releases[0].log
    if trace.explained < 0.5:
        raise SysidError(
            f"{log}: a linear decay explains only {100 * max(0.0, trace.explained):.0f} % of the motion after the release. "
            "If something else moves the joint, mark the free part of the log (--from, --to, --release). If it swings "
            "freely, it is far from linear, as against a stop: `husky-sysid diagnose` names the cause."
        )
    tau, std = float(trace.poles[1]), math.sqrt(trace.covariance[1, 1])
    if tau < (SURE if any(release.driven_until for release in releases) else -SURE) * std:
        growth = 100 * math.expm1(-math.pi * tau * trace.omega_n)
        raise SysidError(
            f"{log}: the swings change by {growth:+.2g} % a period, to the end: something drives the joint. Stop the drive and let it swing, or "
            "mark the free part of the log (--from, --to)."
        )
    if trace.damping_ratio < 1 and not _fixes_stiffness(trace):
        raise SysidError(
            f"{log}: the free motion is too short to tell its frequency ({trace.omega_n:.3g} rad/s ± "
            f"{100 * math.sqrt(trace.covariance[0, 0]):.0f} %). Record faster, tip the deck further, or give more releases."
        )


def _rest_angles(
    releases: Sequence[Release], trace: TraceFit, floor: NoiseFloor
) -> tuple[list[Release], list[Quantity], float]:
    """Return the releases without drift, their rest angles and the noise of their roll [rad]."""
    if trace.signal == "roll":
        rests = [Quantity(f.level, f.level_std, "rad", "whole trace") for f in trace.releases]
        return list(releases), rests, max(BEST_SENSOR * max(r.amplitude for r in releases), floor.std)
    steady: list[Release] = []
    rests: list[Quantity] = []
    variance = 0.0
    for release, fitted in zip(releases, trace.releases, strict=True):
        drift = fitted.level if release.measured == "rate" else 0.0
        roll = release.roll - drift * (release.time - release.time[0])
        begin = int(np.searchsorted(release.time, fitted.trace.time[0]))
        integrated = Trace(release.time[begin:], roll[begin:], np.ones(len(roll) - begin))
        _, residual, _, coefficients, inverse = project(integrated, trace.poles)
        variance += float(np.mean(residual**2)) / len(releases)
        std = float(np.std(residual)) * math.sqrt(inverse[2, 2])
        rests.append(Quantity(float(coefficients[2]), std, "rad", "integrated rate"))
        steady.append(replace(release, roll=roll, rest=float(coefficients[2])))
    return steady, rests, math.sqrt(variance)


def _warnings(decay: FreeDecay) -> list[str]:
    warnings: list[str] = []
    if decay.status == "not linear":
        warnings.append(
            f"a linear law does not hold: {decay.judgement.reason}. k and d are a compromise over the amplitudes seen"
        )
    if decay.status == "cannot tell":
        warnings.append(
            f"the log does not show whether the law is linear: {decay.judgement.reason}. Let go from farther, or record more "
            "releases to both sides"
        )
    if decay.linear and decay.numbers.damping_ratio.ci95[0] <= 0:
        warnings.append(
            f"the damping may be zero (ζ = {decay.numbers.damping_ratio}): record longer, or more releases"
        )
    for release in decay.releases:
        cycles = (release.time[-1] - release.start) * decay.trace.omega_n / (2 * math.pi)
        if release.end != "rest" and cycles < 1 and decay.trace.law != "none":
            warnings.append(
                f"the release at {shown(release.start)} is {'stopped' if release.end == 'caught' else 'cut off'} after "
                f"{cycles:.2f} of a period: its intervals are wide"
            )
    return warnings
