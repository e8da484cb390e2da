"""A free decay in words, tables and JSON."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.quantity import Quantity, slide_unit
from sysid.releases.phases import Phase, log_phases
from sysid.text import WIDTH, linear_law, table

if TYPE_CHECKING:
    from sysid.free_decay import FreeDecay

LABELS = {
    "log_decrement": "log decrement δ",
    "damping_ratio": "damping ratio ζ",
    "period": "period T",
    "omega_d": "damped frequency ω_d",
    "omega_n": "natural frequency ω_n",
    "inertia": "roll inertia I",
    "stiffness": "stiffness k = I ω_n²",
    "damping": "damping d = 2 ζ ω_n I",
}
FROM_INERTIA = ("inertia", "stiffness", "damping")
"""What a free decay alone does not hold."""


def report(decay: "FreeDecay", width: int = WIDTH) -> str:
    """Return logs, releases, quantities, law and verdict."""
    named = f" · {decay.board}" if decay.board else ""
    lines = [
        f"{roll.log} · {len(roll.time)} samples · {roll.sampling_rate:.4g} Hz · {roll.time[-1] - roll.time[0]:.3g} s{named}"
        for roll in (recording.roll for recording in decay.recordings)
    ]
    several = len(decay.recordings) > 1
    shown, si = decay.position, "m" if decay.slides else "rad"
    rows: list[tuple[str, ...]] = []
    for one, peaks in zip(decay.releases, decay.peaks, strict=True):
        name = f"{Path(one.log).name} {one.number}" if several else str(one.number)
        size = f"{one.amplitude:.4f} {si} ({shown.scale * one.amplitude:.2f}{shown.unit})"
        hold = f"{one.hold:.2f} s" if one.hold else "moving"
        end = {"rest": "at rest", "caught": "stopped", "log": "log ends"}[one.end]
        rows.append(
            (name, f"{one.start:.3f}", one.side, size, hold, f"{one.time[-1]:.3f}", end, str(len(peaks)))
        )
    head = ("release", "t [s]", "side", "first amplitude", "held before", "until", "end", "peaks")
    releases = table(head, rows, width=width)
    value = "value ± 95 %" if decay.linear else "value ± 95 % of a linear decay, which this is not"
    quantities = table(("quantity", value, "unit", "how"), _rows(decay), width=width)
    standing = "peaks: turning points that stand above the noise"
    if any(one.end == "caught" for one in decay.releases):
        standing += "; stopped: by a hand, by friction or by what hangs on the deck; what follows is left out"
    lines += [releases, standing, quantities, equation(decay), verdict(decay)]
    if not decay.has_inertia:
        lines.append(
            "k and d need the mass m that slides: k = m ω_n², d = 2 ζ ω_n m"
            if decay.slides
            else "k and d need the roll inertia I about the tilt axis: k = I ω_n², d = 2 ζ ω_n I (husky-sysid inertia)"
        )
    return "\n".join(lines)


def _rows(decay: "FreeDecay") -> list[tuple[str, str, str, str]]:
    shown = decay.numbers.items()
    if not decay.has_inertia:
        shown = [(name, quantity) for name, quantity in shown if name not in FROM_INERTIA]
    rows = [_row(LABELS[name], quantity) for name, quantity in shown]
    others = [] if decay.line is None else [_row(LABELS["log_decrement"], decay.line.log_decrement)]
    others += [] if decay.two_peaks is None else [_row(LABELS["log_decrement"], decay.two_peaks)]
    if decay.numbers.damping_ratio.value >= 1:
        others = []  # there is no peak to look for
    elif decay.line is None:
        others = [(LABELS["log_decrement"], "-", "1", "peaks: noise leaves no second one")]
    return [rows[0], *others, *rows[1:]]


def _row(name: str, quantity: Quantity) -> tuple[str, str, str, str]:
    if math.isnan(quantity.value):
        return name, "none: overdamped", "", quantity.method
    return name, quantity.number, quantity.printed_unit, quantity.method


def equation(decay: "FreeDecay") -> str:
    """Return the identified law, as it would be written on a board; over the inertia where that is not known."""
    numbers = decay.numbers
    rest = sum(angle.value for angle in decay.rest_angles) / len(decay.rest_angles)
    inertia, damping, stiffness = (q.value for q in (numbers.inertia, numbers.damping, numbers.stiffness))
    if not decay.has_inertia:
        omega_n, zeta = numbers.omega_n.value, numbers.damping_ratio.value
        inertia, damping, stiffness = 1.0, 2 * zeta * omega_n, omega_n**2
    left = linear_law(inertia, damping, stiffness, 0.0 if decay.trace.signal == "rate" else rest)
    return f"{left} = 0   (SI{'' if decay.slides else ', rad'})"


def verdict(decay: "FreeDecay") -> str:
    """Say whether the decay is a linear one, and what the intervals are made of."""
    ratio = decay.over_noise
    if not decay.known:
        return "✗ this log does not tell k and d: their intervals are wider than themselves; see the warnings"
    if any(found.hidden_by_linear_fit for found in decay.nonlinearities):
        scale, unit = decay.position.scale, decay.position.unit
        levels = ", ".join(f"{scale * rest.value:+.2f}{unit}" for rest in decay.rest_angles[:6])
        return (
            f"✗ not a linear decay: it rests at {levels}, where a spring and a damper come back to one angle; k and d "
            "do not hold"
        )
    if not decay.linear:
        return f"✗ not a linear decay: the residual is {ratio:.3g} × the estimated sensor noise; see the warnings"
    share = inertia_share(decay.numbers.inertia, decay.numbers.stiffness)
    closing = f"; {100 * share:.0f} % of k's variance comes from I" if share > 0.5 else ""
    wider = f"; the intervals are {decay.wider:.2g} × wider for it" if decay.wider > 1.05 else ""
    if ratio > 1.15:
        size = max(float(abs(fitted.modelled - fitted.level).max()) for fitted in decay.trace.releases)
        left = 100 * decay.trace.noise / size
        return (
            f"✓ linear to {left:.2g} % of the amplitude; what remains is {ratio:.3g} × the scatter from sample to "
            f"sample: the law is not quite linear, or a filter or a fusion makes that scatter small{wider}{closing}"
        )
    lasting = (
        f"; the intervals are {decay.wider:.2g} × wider, for the error lasts" if decay.wider > 1.05 else ""
    )
    return f"✓ linear decay: the residual is {ratio:.2f} × the estimated sensor noise{lasting}{closing}"


def inertia_share(inertia: Quantity, stiffness: Quantity) -> float:
    """Return which share of the variance of the stiffness the roll inertia brings in; 0 where one of them is exact."""
    if not (inertia.std > 0 and stiffness.std > 0):
        return 0.0
    return (inertia.std / inertia.value * stiffness.value / stiffness.std) ** 2


def to_json(decay: "FreeDecay") -> dict[str, Any]:
    """Return the binding result of the command: SI, radians, each quantity with its interval."""
    logs = [recording.roll.log for recording in decay.recordings]
    phases: list[Phase] = []
    for roll in (recording.roll for recording in decay.recordings):
        phases += log_phases(roll, [release for release in decay.releases if release.log == roll.log])
    return {
        "board": decay.board,
        "logs": logs,
        "log": ", ".join(logs or dict.fromkeys(release.log for release in decay.releases)),
        "releases": [
            {
                "log": release.log,
                "number": release.number,
                "t_start_s": release.start,
                "t_end_s": float(release.time[-1]),
                "side": release.side,
                "amplitude_rad": release.amplitude,
                "hold_s": release.hold,
                "end": release.end,
                "rest_angle": rest.to_json(),
                "peaks": [
                    {
                        "t_s": p.time,
                        "angle_rad": p.roll,
                        "half_cycle": p.number,
                        "std_rad": math.hypot(p.std, release.scale_std * p.amplitude),
                    }
                    for p in peaks
                ],
            }
            for release, peaks, rest in zip(decay.releases, decay.peaks, decay.rest_angles, strict=True)
        ],
        "phases": [{"t_start_s": phase.start, "t_end_s": phase.end, "kind": phase.kind} for phase in phases],
        **decay.numbers.to_json(),
        "methods": {
            "whole_trace": {**decay.numbers.to_json(), "signal": decay.trace.signal},
            "peaks": None if decay.from_line is None else decay.from_line.to_json(),
            "two_peaks": None if decay.two_peaks is None else {"log_decrement": decay.two_peaks.to_json()},
        },
        "residual": {
            "rms": decay.trace.noise,
            "noise_floor": decay.floor.std,
            "correlation": decay.trace.correlation,
            "intervals_widened": decay.wider,
            "unit": (slide_unit if decay.slides else str)("rad" if decay.trace.signal == "roll" else "rad/s"),
            "linear": decay.linear,
        },
        "patterns": [{"effects": list(p.effects), "text": p.text} for p in decay.nonlinearities],
        "notes": [note for recording in decay.recordings for note in recording.notes],
        "warnings": list(decay.warnings),
    }
