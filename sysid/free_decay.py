"""Free decay: logarithmic decrement, damping ratio, frequencies, stiffness and damping.

Three ways side by side: the whole trace (the result), the line through all peaks, and the classic two
peaks. Where they disagree, or the trace is not a linear decay, a warning names the likely reason.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.board import Board, require_record
from sysid.decay import report as decay_report
from sysid.decay.linear_fit import BEST_SENSOR, TraceFit, decay_basis, fit_traces
from sysid.decay.misfit import inflate_covariance, over_noise, stated_noise
from sysid.decay.nonlinearity import Nonlinearity, find_nonlinearities
from sysid.decay.numbers import DecayNumbers as DecayNumbers
from sysid.decay.numbers import decay_from_peaks as decay_from_peaks
from sysid.decay.numbers import decay_numbers, numbers_from_decrement
from sysid.decay.peaks import Peak, PeakLine, find_peaks, fit_peak_line
from sysid.decay.peaks import log_decrement_two_peaks as log_decrement_two_peaks
from sysid.decay.plausibility import amplitude_warnings, period_warnings, record_warnings
from sysid.errors import SysidError
from sysid.noise.floor import NoiseFloor, noise_floor
from sysid.noise.whiteness import ljung_box
from sysid.quantity import Quantity, slide_unit
from sysid.recording import Data, Recording, reading_warnings, unpack
from sysid.roll import Array, Release, shown
from sysid.shown import Shown
from sysid.text import WIDTH, Display, count, display, quantity_frame

if TYPE_CHECKING:
    import pandas as pd

DISAGREEMENT_STDS = 2.58
"""Two estimates disagree from this many standard deviations of their difference on (1 % by chance)."""
MIN_DECREMENT_DIFFERENCE = 0.005
"""Two decrements this close, relatively, are never said to disagree: a local cubic is no closer."""
ABOVE_NOISE = 1.15
"""Residuals above this multiple of the noise floor are looked at."""
FEW_IN_PERIOD = 5.0
"""Samples a period below which a hand may pass for a swing: of 36 simulated logs of three releases with 2.6 to 4, six were not told apart, of 36
with 5 to 8 none."""
WORTH_NAMING = 0.007
"""Misfit below this share of the amplitude is not worth a warning."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class FreeDecay(Shown):
    """Result of `fit_decay`: stiffness, damping and frequencies of a board, from its free decays."""

    releases: tuple[Release, ...]
    """The free decays; a gyro's roll without its drift."""
    numbers: DecayNumbers
    """The result: from the whole traces."""
    trace: TraceFit
    peaks: tuple[tuple[Peak, ...], ...]
    """Usable peaks of each release."""
    line: PeakLine | None
    """The line through all peaks; None where noise leaves no second one."""
    from_line: DecayNumbers | None
    two_peaks: Quantity | None
    """The classic δ of two peaks of the first release that has them."""
    rest_angles: tuple[Quantity, ...]
    """Rest angle of each release [rad]."""
    floor: NoiseFloor
    """Sensor noise of what the trace was fitted to."""
    nonlinearities: tuple[Nonlinearity, ...]
    """Deviations from a linear decay that peaks and rest levels show."""
    wider: float
    """Factor by which intervals are widened for a residual beyond the noise; 1 where it may be noise."""
    over_noise: float
    """Residual over the sensor's noise [1]; of the rate, where the roll was made from one."""
    linear: bool
    """Whether a linear decay explains the traces to the noise or a negligible residual, with one rest level."""
    warnings: tuple[str, ...]
    """Problems of the logs and of the decay, and contradictions to the board's record."""
    recordings: tuple[Recording, ...] = ()
    """The logs, where they were given whole."""
    board: str | None = None
    """Name of the board, where its record was given."""

    @property
    def slides(self) -> bool:
        """Whether the joint is a slide."""
        return self.numbers.inertia.unit == "kg"

    @property
    def position(self) -> Display:
        """How the roll, or the position of a slide, is displayed."""
        return display(is_rate=False, slides=self.slides)

    @property
    def show(self) -> Display:
        """How the fitted signal is displayed."""
        return self.position if self.trace.signal == "roll" else display(is_rate=True, slides=self.slides)

    @property
    def has_inertia(self) -> bool:
        """Whether the roll inertia was given; without it there is no k and no d."""
        return math.isfinite(self.numbers.inertia.value)

    @property
    def known(self) -> bool:
        """Whether the interval of ω_n², and so of k/I, is narrower than its value."""
        omega = self.numbers.omega_n
        return omega.ci95[1] - omega.value < omega.value / 2

    @property
    def status(self) -> str:
        """Whether the decay is 'linear' or 'not linear'."""
        return "linear" if self.linear else "not linear"

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
        """Return what `husky-sysid decay` prints, in tables of at most `width` characters."""
        return decay_report.report(self, width)

    def to_json(self) -> dict[str, Any]:
        """Return what `husky-sysid decay --json` writes: SI, radians, each quantity with its 95 % interval."""
        return decay_report.to_json(self)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return one row a quantity: value, std, low and high end of the 95 % interval, unit, how."""
        return quantity_frame(dict(self.numbers.items()))


NO_INERTIA = Quantity(math.nan, math.nan, "kg*m^2", "not given")
"""A free decay holds k/I and d/I only."""


def fit_decay(data: Data, inertia: Quantity | None = None, *, board: Board | None = None) -> FreeDecay:
    """Identify a linear tilt joint from its free decays.

    Args:
        data: Free decays of one board: a recording, several, or releases.
        inertia: Roll inertia about the tilt axis [kg*m^2]; its uncertainty goes into k and d. Without it, and without
            a board, the numbers are ω, ζ and δ only, and k and d are NaN.
        board: The record; gives the inertia where that is left out, and is compared with the decay.

    Raises:
        SysidError: The decays hold too little to say anything, or do not look like a decay at all.
    """
    recordings, releases, weak = unpack(data)
    if board is None:
        slides = all(release.slides for release in releases)
        decay = _fit(releases, inertia or (replace(NO_INERTIA, unit="kg") if slides else NO_INERTIA))
        doubts = (*amplitude_warnings(releases, None), *decay.warnings)
    else:
        require_record(board)
        odd = amplitude_warnings(releases, board)
        decay = _fit(releases, inertia or board.inertia)
        log = ", ".join(dict.fromkeys(release.log for release in releases))
        doubts = (
            *odd,
            *decay.warnings,
            *period_warnings(decay.numbers.omega_n.value, board, log=log),
            *record_warnings(
                decay.numbers,
                board,
                log=log,
                linear=decay.linear,
                one_sided=len({release.side for release in releases}) == 1,
            ),
        )
    return replace(
        decay,
        warnings=(*reading_warnings(recordings), *weak, *doubts),
        recordings=recordings,
        board=None if board is None else board.name,
    )


def _fit(releases: Sequence[Release], inertia: Quantity) -> FreeDecay:
    """Fit a linear decay to all releases together, three ways."""
    trace = fit_traces(releases)
    floor = noise_floor(releases, rate=trace.signal == "rate")
    _refuse_nonsense(releases, trace)
    trace, wider = inflate_covariance(trace, floor)
    freedom, method = trace.degrees_of_freedom, f"whole trace of {count(len(releases), 'release')}"
    numbers = decay_numbers(
        trace.omega_n,
        trace.damping_ratio,
        trace.covariance,
        inertia,
        degrees_of_freedom=freedom,
        method=method,
    )
    steady, rests, noise = _rest_angles(releases, trace, floor)
    peaks = [
        find_peaks(release, rest.value, trace.omega_n, numbers.omega_d.value, noise)
        if trace.damping_ratio < 1
        else []
        for release, rest in zip(steady, rests, strict=True)
    ]
    line = fit_peak_line(peaks, [rest.std for rest in rests])
    levels = [_with_zero(rest, release) for rest, release in zip(rests, releases, strict=True)]
    levels = levels if trace.signal == "roll" else []
    nonlinearities = tuple(find_nonlinearities(steady, peaks, noise, levels))
    from_line = None
    if line is not None:
        from_line = numbers_from_decrement(
            line.log_decrement, line.period, inertia, degrees_of_freedom=line.degrees_of_freedom,
            method=line.log_decrement.method,
        )  # fmt: skip
    pairs = (log_decrement_two_peaks(group, rest.std) for group, rest in zip(peaks, rests, strict=True))
    ratio = over_noise(releases, trace, floor)
    linear = _is_linear(trace, floor, ratio) and not any(
        found.hidden_by_linear_fit for found in nonlinearities
    )
    decay = FreeDecay(
        releases=tuple(steady),
        numbers=numbers,
        trace=trace,
        peaks=tuple(tuple(group) for group in peaks),
        line=line,
        from_line=from_line,
        two_peaks=next((delta for delta in pairs if delta is not None), None),
        rest_angles=tuple(rests),
        floor=floor,
        nonlinearities=nonlinearities,
        wider=wider,
        over_noise=ratio,
        linear=linear,
        warnings=(),
    )
    return replace(decay, warnings=tuple(_warnings(decay)))


def _refuse_nonsense(releases: Sequence[Release], trace: TraceFit) -> None:
    """Refuse where the numbers would mean nothing."""
    log = releases[0].log
    if trace.explained < 0.5:
        step = float(np.median(np.concatenate([np.diff(release.time) for release in releases])))
        in_period = 2 * math.pi / (trace.omega_n * step)
        slow = (
            f"It has {in_period:.2g} samples a period, too few to tell a hand from a swing: record faster, or one release a log. "
            if in_period < FEW_IN_PERIOD
            else ""
        )
        raise SysidError(
            f"{log}: a linear decay explains only {100 * max(0.0, trace.explained):.0f} % of the motion after the "
            f"release. {slow}Where something else moves the joint, mark the free part of the log (--from, --to, --release). "
            "Where it swings freely, it is far from linear, as against a stop: `husky-sysid diagnose` names the cause."
        )
    spread = math.sqrt(trace.covariance[0, 0]) / trace.omega_n
    if not spread < 0.25:
        raise SysidError(
            f"{log}: the free motion is too short or too strongly damped to tell its frequency "
            f"({trace.omega_n:.3g} rad/s ± {200 * spread:.0f} %). Record faster, tip the deck further, or give "
            "more releases."
        )


def _rest_angles(
    releases: Sequence[Release], trace: TraceFit, floor: NoiseFloor
) -> tuple[list[Release], list[Quantity], float]:
    """Return the releases without drift, their rest angles and the noise of their roll [rad]."""
    if trace.signal == "roll":
        rests = [Quantity(f.level, f.level_std, "rad", "whole trace") for f in trace.releases]
        finest = BEST_SENSOR * max(release.amplitude for release in releases)
        return list(releases), rests, max(finest, stated_noise(trace, floor))
    steady: list[Release] = []
    rests: list[Quantity] = []
    variance = 0.0
    for release, fitted in zip(releases, trace.releases, strict=True):
        roll = release.roll - fitted.level * (release.time - release.time[0])
        begin = int(np.searchsorted(release.time, fitted.trace.time[0]))
        rest, std, residual = _level(release.time[begin:], roll[begin:], trace)
        variance += float(np.mean(residual**2)) / len(releases)
        rests.append(Quantity(rest, std, "rad", "integrated rate"))
        steady.append(replace(release, roll=roll, rest=rest))
    return steady, rests, math.sqrt(variance)


def _with_zero(rest: Quantity, release: Release) -> Quantity:
    """Return a rest angle [rad] as well as it is known beside those of other releases: where the sensor's zero wanders, no better than that."""
    zero = float(np.median(release.std)) if release.zero == "drifting" else 0.0
    return replace(rest, std=math.hypot(rest.std, zero))


def _level(time: Array, roll: Array, trace: TraceFit) -> tuple[float, float, Array]:
    """Return the rest angle of an integrated rate, its std and the residual, the poles being known."""
    a = trace.omega_n * trace.damping_ratio
    u, v = decay_basis(time - time[0], a, trace.omega_n**2 - a * a)
    basis = np.column_stack([u, v, np.ones_like(time)])
    inverse = np.asarray(np.linalg.pinv(basis), dtype=np.float64)
    coefficients = inverse @ roll
    residual = roll - basis @ coefficients
    return float(coefficients[2]), float(np.std(residual)) * float(np.linalg.norm(inverse[2])), residual


def _is_linear(trace: TraceFit, floor: NoiseFloor, ratio: float) -> bool:
    """Whether what the fit leaves is noise, or too small to matter."""
    size = max(float(np.abs(fitted.modelled - fitted.level).max()) for fitted in trace.releases)
    misfit = math.sqrt(max(0.0, trace.noise**2 - stated_noise(trace, floor) ** 2))
    statistic, degrees = ljung_box([fitted.residual for fitted in trace.releases])
    white = statistic < degrees + 6.0 * math.sqrt(2.0 * degrees)
    return white or ratio < ABOVE_NOISE or misfit < WORTH_NAMING * size


def _warnings(decay: FreeDecay) -> list[str]:
    texts = (
        _not_known(decay),
        _not_linear(decay),
        _drift(decay),
        _disagreement(decay),
        _damping_regime(decay),
    )
    warnings = [text for text in texts if text]
    for release in decay.releases:
        cycles = (release.time[-1] - release.start) / (2 * math.pi / decay.trace.omega_n)
        if release.end != "rest" and cycles < 1:
            warnings.append(
                f"the release at {shown(release.start)} is {'stopped' if release.end == 'caught' else 'cut off'} after "
                f"{cycles:.2f} of a period: its intervals are wide"
            )
    return warnings


def _not_known(decay: FreeDecay) -> str | None:
    if decay.known:
        return None
    return (
        f"the interval of the frequency ({decay.numbers.omega_n}) makes that of k wider than k itself: the log does not "
        "tell it. Is it the right column (--column) and the right part (--from, --to)? Else record faster, or more releases"
    )


def _not_linear(decay: FreeDecay) -> str | None:
    if decay.linear:
        return None
    unit = slide_unit if decay.slides else str
    unit = unit("rad" if decay.trace.signal == "roll" else "rad/s")
    reasons = (
        "; ".join(found.told for found in decay.nonlinearities) or "the residual has a shape, see the picture"
    )
    if any(found.hidden_by_linear_fit for found in decay.nonlinearities):
        return (
            f"a linear decay is the wrong model, although its residual is only {decay.trace.noise:.2g} {unit} at a noise "
            f"of {decay.floor.std:.2g} {unit}: {reasons}. A rest angle for each release hides this in the fit, so k and d "
            "can be wrong by far more than their intervals; `diagnose` tells the causes apart"
        )
    return (
        f"a linear decay is not the whole story: it leaves {decay.trace.noise:.2g} {unit} where the sensor's noise "
        f"is {decay.floor.std:.2g} {unit}. {reasons[0].upper()}{reasons[1:]}. k and d are a compromise over the "
        "amplitudes seen; `diagnose` tells the causes apart"
    )


def _drift(decay: FreeDecay) -> str | None:
    """Say that the sensor's zero moves where a linear decay is right otherwise."""
    drift = next((found for found in decay.nonlinearities if found.sign == "moving level"), None)
    if drift is None or not decay.linear:
        return None
    return f"{drift.told}. Each release is fitted with its own rest angle, so k and d do not depend on it"


def _disagreement(decay: FreeDecay) -> str | None:
    """Compare δ of the line through the peaks with δ of the whole trace."""
    if decay.line is None:
        return None
    one, other = decay.line.log_decrement, decay.numbers.log_decrement
    apart = abs(one.value - other.value)
    if not apart > max(
        DISAGREEMENT_STDS * math.hypot(one.std, other.std), MIN_DECREMENT_DIFFERENCE * other.value
    ):
        return None
    return (
        f"δ from the peaks ({one}) and from the whole trace ({other}) disagree by more than their intervals. "
        f"Likely: {_why(decay)}"
    )


def _why(decay: FreeDecay) -> str:
    if decay.nonlinearities:
        return decay.nonlinearities[0].told
    used = [
        (group, rest) for group, rest in zip(decay.peaks, decay.rest_angles, strict=True) if len(group) > 1
    ]
    last, rest = used[0][0][-1], used[0][1]
    clear = last.amplitude / math.hypot(last.std, rest.std)
    if len(used[0][0]) <= 3 and clear < 20:
        return (
            f"the last of {len(used[0][0])} peaks stands only {clear:.0f} standard deviations above the noise, and "
            "all of δ hangs on it; trust the whole trace"
        )
    if any(release.end == "caught" for release in decay.releases):
        return "something stopped the deck (a hand, friction) before the end that was found; shorten it with --to"
    if len(used[0][0]) <= 3:
        return (
            "the first peak is not on the line, because the deck was not let go cleanly or the law is not linear "
            "at large angles"
        )
    return "the rest angle moves during the decay, or the law is not linear; see the log-amplitude line"


def _damping_regime(decay: FreeDecay) -> str | None:
    zeta = decay.numbers.damping_ratio
    if zeta.value >= 1:
        return (
            f"overdamped (ζ = {zeta}): nothing oscillates, so there is no decrement and no period. k and d come from "
            "the shape of the return alone"
        )
    if zeta.ci95[0] <= 0 and decay.linear:  # of another law it is an average, however long the log is
        return f"the damping cannot be told from zero (ζ = {zeta}): record longer, or more releases"
    return None
