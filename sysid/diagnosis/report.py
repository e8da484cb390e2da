"""A diagnosis in words, tables and JSON."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.diagnosis.evidence import ODDS
from sysid.effects import origin
from sysid.quantity import Z95
from sysid.text import count, display, percent, table
from sysid.workspace import Workspace

if TYPE_CHECKING:
    from sysid.diagnosis.diagnose import Diagnosis
    from sysid.diagnosis.posterior import Size

TIE = 2 * math.log(ODDS)
"""Score up to which two candidates tie: twice the log of the odds at which one set beats another, 6."""


def headline(result: "Diagnosis") -> str:
    """Return the verdict in a few words."""
    names = " and ".join(result.verdict.effects)
    if result.status == "none-missing":
        return "no effect is missing"
    if result.status == "missing":
        return f"{names} {'is' if len(result.verdict.effects) == 1 else 'are'} missing"
    return "part of the torque has no name in the catalogue"


def explanation(result: "Diagnosis") -> str:
    """Return the verdict as sentences."""
    verdict, found = result.verdict, result.posterior
    noise = result.noise.std
    parts: list[str] = []
    if result.status == "missing" and result.best.effects:
        parts.append(
            f"With {_listed(result.best.effects)} the error falls from {result.baseline.rmse / noise:.3g} to {result.best.rmse / noise:.3g} "
            f"times the noise ({percent(result.explained)} of the squared error beyond it)."
        )
    else:
        left = f"{result.best.rmse / noise:.3g} times the noise"
        if result.remainder:
            left += (
                f", {percent(result.remainder / result.baseline.fit.measured_rms)} of the motion beyond it"
            )
        if result.status == "none-missing":
            parts.append(f"The record's law leaves {left}; nothing that matters is missing.")
        elif result.status == "unexplained":
            parts.append(f"The best candidate leaves {left}.")
            if not found.by_cycles:
                parts.append(
                    f"A torque without a name carries {percent(found.nameless)} of the spring's (RMS)."
                )
    parts += [
        f"{family}: {size_in_words(found.sizes[family])}."
        for family in verdict.families
        if family in found.sizes
    ]
    if found.by_cycles:
        parts.append(
            "Amplitude and phase of each cycle proposed the laws: the decay is light and the waveform is not exact."
        )
    if found.motion.free[:, 0].any():
        parts.append("A hand acted when the releases began: the fits leave it out.")
    parts += [result.record_text] if result.record_text else []
    parts += [f"Hint: {_hint(hint)}." for hint in verdict.hints]
    return " ".join(parts)


def _hint(hint: Any) -> str:
    size = "" if hint.size is None else f", {size_in_words(hint.size)}"
    return f"{_listed(hint.effects)}, probability {percent(hint.probability)}{size}"


def size_in_words(size: "Size") -> str:
    """Return the size of a family with its 95 % intervals; a spring takes no energy."""
    peak = f"{_share(size.torque_share, size.torque_std)} of the peak torque"
    if round(100 * size.energy_share) == 0:
        return peak
    return f"{peak}, {_share(size.energy_share, size.energy_std)} of the energy lost"


def _share(share: float, std: float) -> str:
    """Return a share in whole percents with its 95 % interval; without one where the log sets no limit."""
    half = f" ± {100 * Z95 * std:.0f} %" if Z95 * std < 1 else ""
    return f"{100 * share:.0f} %{half}"


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 2 else names)


def report(result: "Diagnosis", width: int, space: Workspace, logs: Sequence[Path]) -> str:
    """Return verdict, candidates and the next step."""
    verdict, noise = result.verdict, result.noise
    show = display(is_rate=result.is_rate, slides=result.slides)
    rows = [
        (
            "→" if c is result.best else "", ", ".join(c.effects) or "(the record's law)", f"{c.rmse / noise.std:.3f}",
            f"{c.heldout_rmse / noise.std:.3f}", f"{c.score:.1f}",
        )
        for c in result.candidates
    ]  # fmt: skip
    lines = [
        f"Result: {headline(result)} (confidence {percent(verdict.confidence)})",
        explanation(result),
        f"{result.board} · {count(len(result.releases), 'release')} · sensor noise {show(noise.std, 3)}, {noise.how}",
        table(("", "effects", "error / noise", "held out / noise", "score"), rows, width=width),
        f"score: twice the log evidence below the best; under {TIE:.0f} is a tie. held out: error on a release that the fit did not see",
    ]
    lines += [f"looks the same in these logs: {', '.join(group)}" for group in verdict.indistinguishable_from]
    if result.next_experiment:
        lines.append(f"next experiment: {result.next_experiment}")
    if result.status == "unexplained":
        lines.append(f"to learn the torque: {_fit(result, space, logs, ('learned',))}")
    if result.effects:
        lines.append(f"to add it: {_fit(result, space, logs, result.effects)}")
    return "\n".join(lines)


def _fit(result: "Diagnosis", space: Workspace, logs: Sequence[Path], names: Sequence[str]) -> str:
    """Return the command that fits effects to the logs that were diagnosed."""
    added: list[str] = []
    for name in names:
        added += ["--effect-file", file] if (file := origin(name)).endswith(".py") else ["--effect", name]
    return space.command("fit", *result.options, *added, *without_hand(result), logs=logs)


def without_hand(result: "Diagnosis") -> tuple[str, ...]:
    """Return the options that begin the decays of a log where the hand had let go; none where no hand acted."""
    if len(result.logs) > 1 or not result.posterior.motion.free[:, 0].any():
        return ()
    return tuple(word for one in result.releases for word in ("--release", f"{one.start:.3f}"))


def to_json(result: "Diagnosis") -> dict[str, Any]:
    """Return the binding result of the command."""
    verdict, found = result.verdict, result.posterior
    # An error of a rate, as the amplitude of a swing at the natural frequency that has that rate.
    per = 1.0 / result.baseline.fit.law.frequency if result.is_rate else 1.0
    content: dict[str, Any] = {
        "board": result.board,
        "logs": list(result.logs),
        "signal": "rate" if result.is_rate else "roll",
        "noise_floor_rad": per * result.noise.std,
        "baseline": {
            "rmse_rad": per * result.baseline.rmse,
            "heldout_rmse_rad": per * result.baseline.heldout_rmse,
        },
        "candidates": [
            {
                "effects": list(c.effects),
                "rmse_rad": per * c.rmse,
                "heldout_rmse_rad": per * c.heldout_rmse,
                "score": c.score,
                "parameters": {name: quantity.to_json() for name, quantity in c.parameters.items()},
            }
            for c in result.candidates
        ],
        "verdict": {
            "status": verdict.status,
            "effects": list(verdict.effects),
            "confidence": verdict.confidence,
            "indistinguishable_from": [list(group) for group in verdict.indistinguishable_from],
            "error_before_rad": per * result.baseline.rmse,
            "error_after_rad": per * result.best.rmse,
            "next_experiment": result.next_experiment,
            "explanation": explanation(result),
            "families": list(verdict.families),
            "explained": result.explained,
            "matters": _matters(result),
            "remainder": {
                "rmse_rad": per * result.remainder,
                "text": f"{result.best.rmse / result.noise.std:.3g} times the noise",
            },
            "hints": [
                {
                    "effects": list(h.effects),
                    "probability": h.probability,
                    "size": None if h.size is None else _size(h.size),
                    "text": _hint(h),
                }
                for h in verdict.hints
            ],
            "learned": None,
            "sets": [{"effects": list(s.effects), "probability": s.probability} for s in found.sets],
            "inclusion": dict(found.inclusion),
            "sizes": {family: _size(size) for family, size in found.sizes.items()},
        },
        "warnings": list(result.doubts),
    }
    return _finite(content)


def _matters(result: "Diagnosis") -> dict[str, float] | None:
    sizes = [result.posterior.sizes[f] for f in result.verdict.families if f in result.posterior.sizes]
    if not sizes:
        return None
    return {
        "torque_share": max(s.torque_share for s in sizes),
        "energy_share": sum(s.energy_share for s in sizes),
        "amplitude_after_10_periods": _after_ten(result),
    }


def _after_ten(result: "Diagnosis") -> float:
    """Return the amplitude of the best law over that of the record's, ten periods after the widest release."""
    import numpy as np

    from sysid.joint.trajectory import simulate

    first, law = result.baseline.fit.law, result.best.fit.law
    widest = max(result.releases, key=lambda r: r.amplitude)
    period = 2 * math.pi / first.frequency
    time = np.linspace(0.0, 10 * period, 1000)
    swings = [
        float(np.ptp(simulate(one, time, one.rest_angle + widest.roll[0] - widest.rest).roll[-100:]))
        for one in (first, law)
    ]
    return swings[1] / max(swings[0], 1e-12)


def _size(size: "Size") -> dict[str, Any]:
    values = {
        "torque_share": (size.torque_share, size.torque_std),
        "energy_share": (size.energy_share, size.energy_std),
    }
    return {
        name: {"value": v, "std": s, "ci95": [v - 1.96 * s, v + 1.96 * s], "unit": "1"}
        for name, (v, s) in values.items()
    }


def _finite(value: Any) -> Any:
    """Return a value with null for every number that JSON cannot hold: a runaway model's error is infinite."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]  # pyright: ignore[reportUnknownVariableType]
    return None if isinstance(value, float) and not math.isfinite(value) else value
