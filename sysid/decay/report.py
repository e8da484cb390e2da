"""A free decay in words, tables and JSON."""

import math
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

from sysid.decay.numbers import NUMBERS
from sysid.quantity import Quantity, slide_unit
from sysid.releases.phases import Phase, log_phases
from sysid.text import WIDTH, count, linear_law, table

if TYPE_CHECKING:
    from sysid.free_decay import FreeDecay

OTHERS = {
    "stiffness_over_damping": "return rate k/d",
    "damping_over_inertia": "damping d/I",
    "friction_over_inertia": "dry friction/I",
}
ENDS = {"rest": "at rest", "caught": "stopped", "log": "log ends"}
LAWS = {"spring": "spring", "pendulum": "pendulum: torque k sin φ", "none": "no restoring torque"}


def report(decay: "FreeDecay", width: int = WIDTH) -> str:
    """Return logs, releases, quantities, law and verdict."""
    named = f" · {decay.board}" if decay.board else ""
    lines = [
        f"{one.roll.log} · {len(one.roll.time)} samples · {one.roll.sampling_rate:.4g} Hz · "
        f"{one.roll.time[-1] - one.roll.time[0]:.3g} s{named} · {100 * one.used:.0f} % of the motion is free"
        for one in decay.recordings
    ]
    several = len(decay.recordings) > 1
    rows: list[tuple[str, ...]] = []
    for one, peaks in zip(decay.releases, decay.peaks, strict=True):
        name = f"{Path(one.log).name} {one.number}" if several else str(one.number)
        size = f"{decay.position.scale * (one.roll[0] - one.rest):+.4g}{decay.position.unit}"
        hold = f"{one.hold:.2f} s" if one.hold else "moving"
        rows.append(
            (name, f"{one.start:.3f}", size, hold, f"{one.time[-1]:.3f}", ENDS[one.end], str(len(peaks)))
        )
    head = ("release", "t [s]", "amplitude", "held", "until", "end", "peaks")
    shown = [(NUMBERS[name][0], q) for name, q in decay.numbers.items() if math.isfinite(q.value)]
    shown += [(OTHERS[name], q) for name, q in decay.others.items()]
    cells = [(name, q.number, q.printed_unit) for name, q in shown]
    value = "value ± 95 %" if decay.linear else "value ± 95 %, if the law were linear"
    lines += [
        table(head, rows, width=width),
        table(("quantity", value, "unit"), cells, width=width),
        f"from the whole trace of {count(len(decay.releases), 'release')}, {decay.show.name}; {LAWS[decay.trace.law]}",
    ]
    if decay.two_peaks is not None:
        lines.append(f"δ = {decay.two_peaks} from two peaks alone, the {decay.two_peaks.method}")
    if decay.trace.law != "none":
        lines.append(equation(decay))
    lines.append(verdict(decay))
    if not decay.has_inertia:
        lines.append(
            "k and d need the mass m that slides: k = m ω_n², d = 2 ζ ω_n m"
            if decay.slides
            else "k and d need the inertia I: k = I ω_n², d = 2 ζ ω_n I (husky-sysid inertia)"
        )
    narrow = (
        line if "\n" in line else fill(line, width, break_long_words=False, break_on_hyphens=False)
        for line in lines
    )
    return "\n".join(narrow)


def equation(decay: "FreeDecay") -> str:
    """Return the identified law as an equation; divided by the inertia if that is unknown."""
    omega_n, zeta = decay.trace.omega_n, decay.trace.damping_ratio
    inertia = decay.numbers.inertia.value if decay.has_inertia else 1.0
    rest = sum(angle.value for angle in decay.rest_angles) / len(decay.rest_angles)
    rest = 0.0 if decay.trace.signal == "rate" else rest
    left = linear_law(inertia, 2 * zeta * omega_n * inertia, omega_n**2 * inertia, rest)
    if decay.trace.law == "pendulum":
        head, _, angle = left.rpartition(" φ") if left.endswith(" φ") else left.rpartition(" (")
        left = f"{head} sin φ" if left.endswith(" φ") else f"{head} sin({angle}"
    return f"{left} = 0   (SI{'' if decay.slides else ', rad'})"


def verdict(decay: "FreeDecay") -> str:
    """Return whether the linear law holds, and the next step if not."""
    judgement, others = decay.judgement, decay.others
    ratio = f"the residual is {judgement.over_noise:.2f} × the sensor noise"
    wider = f"; intervals {judgement.wider:.2g} × wider for it" if judgement.wider > 1.05 else ""
    if decay.status == "cannot tell":
        return f"✗ this log cannot tell: {judgement.reason}. Next: let go from farther, or more releases"
    if decay.status == "not linear":
        return f"✗ not linear: {judgement.reason}; {ratio}. Next: husky-sysid diagnose"
    if decay.trace.law == "none":
        return f"✓ no restoring torque: d/I and friction/I from the coast-down; {ratio}"
    if decay.trace.law == "pendulum":
        return f"✓ large angles: a pendulum, not a spring; {ratio}{wider}"
    if math.isnan(decay.numbers.omega_n.value):
        return f"✓ overdamped: only k/d = {others['stiffness_over_damping']} is fixed; {ratio}{wider}"
    share = inertia_share(decay.numbers.inertia, decay.numbers.stiffness)
    closing = f"; {100 * share:.0f} % of k's variance comes from I" if share > 0.5 else ""
    return f"✓ linear: the early half of each release predicts the late one; {ratio}{wider}{closing}"


def inertia_share(inertia: Quantity, stiffness: Quantity) -> float:
    """Return the share of the variance of the stiffness that comes from the roll inertia; 0 if one of them is exact."""
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
        **{name: quantity.to_json() for name, quantity in decay.others.items()},
        "methods": {
            "whole_trace": {**decay.numbers.to_json(), "signal": decay.trace.signal},
            "two_peaks": None if decay.two_peaks is None else {"log_decrement": decay.two_peaks.to_json()},
        },
        "residual": {
            "rms": decay.trace.noise,
            "noise_floor": decay.floor.std,
            "correlation": decay.trace.correlation,
            "over_noise": decay.judgement.over_noise,
            "intervals_widened": decay.judgement.wider,
            "unit": (slide_unit if decay.slides else str)("rad" if decay.trace.signal == "roll" else "rad/s"),
            "linear": decay.linear,
            "status": decay.status,
            "law": decay.trace.law,
            "reason": decay.judgement.reason,
        },
        "used": {str(one.path): one.used for one in decay.recordings},
        "notes": [note for recording in decay.recordings for note in recording.notes],
        "warnings": list(decay.warnings),
    }
