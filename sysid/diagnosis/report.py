"""A diagnosis in words, tables and JSON."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.diagnosis.judgement import TIE
from sysid.diagnosis.wording import rounded
from sysid.effects import effect, origin
from sysid.text import count, display, percent, table
from sysid.workspace import Workspace

if TYPE_CHECKING:
    from sysid.diagnosis.diagnose import Candidate, Diagnosis

SHOWN = 8
"""Models in the table."""
STRETCHES = 8
"""Stretches in the table."""
TIED = 2 * TIE
"""Score up to which two models are not told apart: it is twice a log-likelihood [1]."""


def fittable(names: Sequence[str]) -> tuple[str, ...]:
    """Return those of some effects that `fit` can add: not what is another number of the record."""
    parts = [effect(name) for name in names]  # one that was tried beside another has been found so
    return tuple(part.name for part in parts if part.identifiable_from_decay or part.identifiable_with)


def report(result: "Diagnosis", width: int, space: Workspace, logs: Sequence[Path]) -> str:
    """Return the ranked models, the verdict, how well unseen releases are predicted, and what to do next."""
    verdict, floor = result.verdict, result.noise
    show = display(is_rate=result.swing_frequency is not None, slides=result.slides)
    held_out = "each third of the release though its numbers may move as far as the other two"
    if len(result.heldout_before) > 1:
        held_out = "a release though its numbers may move as far as the others"
    rows = [_row(candidate, floor.std) for candidate in result.candidates[:SHOWN]]
    if not any(candidate.effects == () for candidate in result.candidates[:SHOWN]):
        rows.append(_row(result.baseline, floor.std))
    lines = [
        f"{result.board} · {count(result.releases, 'release')} · sensor noise {show(floor.std, 3)}, {floor.how}",
        table(("missing", "error / noise", "held out / noise", "score"), rows, width=width),
        f"held out: what a model misses of {held_out} leave them open; of means of "
        "neighbouring samples where the log has many a period, which are less noisy than the samples of the error",
        "score: twice the log-likelihood of unseen motion that the best has more; models up to "
        f"{TIED:g}, or more where periods disagree or none is exact, are not told apart: the simplest counts, if what it adds matters",
        f"Result: {headline(result)} (confidence {percent(verdict.confidence)})",
        verdict.explanation,
        _predicted(result, width),
        "off by: error over the RMS motion",
    ]
    lines += [
        f"  looks the same in these logs: {', '.join(group)}" for group in verdict.indistinguishable_from
    ]
    if verdict.next_experiment:
        lines.append(f"next experiment: {verdict.next_experiment}")
    if result.learned is not None:
        errors = (show(error) for error in (result.learned.error_after, result.learned.heldout_rmse))
        lines.append("{} (error {}, held out {})".format(result.learned.text, *errors))
        lines.append(result.learned.compared)
        command = _fit(result, space, logs, (*result.effects, "learned"))
        refused = result.learned.refused
        lines.append(f"not to be learned yet: {refused}" if refused else f"to learn it: {command}")
    if result.effects and not result.ends_at_bound:
        held = [word for name, value in result.held.items() for word in ("--fix", f"{name}={value:g}")]
        lines.append(f"to add it: {_fit(result, space, logs, result.effects, *held)}")
    return "\n".join(lines)


def _fit(
    result: "Diagnosis", space: Workspace, logs: Sequence[Path], names: Sequence[str], *held: str
) -> str:
    """Return the command that fits effects to the logs that were diagnosed."""
    added: list[str] = []
    for name in names:
        added += ["--effect-file", file] if (file := origin(name)).endswith(".py") else ["--effect", name]
    return space.command("fit", *result.options, *added, *held, logs=logs)


def headline(result: "Diagnosis") -> str:
    """Return the verdict in a few words."""
    names = " and ".join(result.verdict.effects)
    if result.status == "none-missing":
        return "no effect is missing"
    if result.status == "missing":
        return f"{names} {'is' if len(result.verdict.effects) == 1 else 'are'} missing"
    return "something is missing that no effect of the catalogue explains" + (
        f"; nearest: {names}" if names else ""
    )


def _row(candidate: "Candidate", floor: float) -> tuple[str, ...]:
    held = "-" if candidate.heldout_rmse is None else f"{candidate.heldout_rmse / floor:.3f}"
    name = ", ".join(candidate.effects) or "(nothing)"
    return name, f"{candidate.rmse / floor:.3f}", held, f"{candidate.score:.1f}"


def _predicted(result: "Diagnosis", width: int) -> str:
    """Return a table of how well each release or stretch is predicted from the others, the worst where there are many."""
    errors = {"off by": result.heldout_before}
    if result.status != "none-missing" and result.heldout_after != result.heldout_before:
        how = "with the nearest effects" if result.status == "unexplained" else "with what is missing"
        errors = {f"off by, {how}": result.heldout_after, "without": result.heldout_before}
    each = list(zip(*errors.values(), strict=True))
    names = result.stretches if len(each) > 1 else ["thirds of the release"]
    worst = sorted(range(len(each)), key=lambda i: -each[i][0])[:STRETCHES]
    what = f"predicted from the others{f', the {STRETCHES} worst of {len(each)}' if len(each) > STRETCHES else ''}"
    rows = [(names[i], *(f"{rounded(100 * error)} %" for error in each[i])) for i in sorted(worst)]
    return table((what, *errors), rows, width=width)


def to_json(result: "Diagnosis") -> dict[str, Any]:
    """Return the binding result of the command."""
    verdict = result.verdict
    # An error of a measured rate, as the amplitude of a swing at the joint's frequency that has that rate.
    per = 1.0 if result.swing_frequency is None else 1.0 / result.swing_frequency
    baseline, heldout = result.baseline, result.baseline.heldout_rmse
    content: dict[str, Any] = {
        "board": result.board,
        "logs": list(result.logs),
        "signal": "roll" if result.swing_frequency is None else "rate",
        "noise_floor_rad": per * result.noise.std,
        "baseline": {
            "rmse_rad": per * baseline.rmse,
            "heldout_rmse_rad": None if heldout is None else per * heldout,
        },
        "candidates": [
            {
                "effects": list(c.effects),
                "rmse_rad": per * c.rmse,
                "heldout_rmse_rad": None if c.heldout_rmse is None else per * c.heldout_rmse,
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
            "heldout_nrmse_before": list(result.heldout_before),
            "heldout_nrmse_after": list(result.heldout_after),
            "error_before_rad": per * verdict.error_before,
            "error_after_rad": per * verdict.error_after,
            "next_experiment": verdict.next_experiment,
            "explanation": verdict.explanation,
            "share_of_peak_torque": dict(result.shares),
            "families": list(verdict.families),
            "explained": verdict.explained,
            "matters": None if verdict.matters is None else verdict.matters.to_json(),
            "remainder": {"rmse_rad": per * verdict.remainder, "text": verdict.remainder_text},
            "hints": [
                {"effects": list(hint.effects), "size": hint.size.to_json(), "text": hint.text}
                for hint in verdict.hints
            ],
            **({} if result.learned is None else {"learned": result.learned.to_json(per)}),
        },
        "warnings": list(result.doubts),
    }
    return _finite(content)


def _finite(value: Any) -> Any:
    """Return a value with null for every number that JSON cannot hold: a runaway model's error is infinite."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]  # pyright: ignore[reportUnknownVariableType]
    return None if isinstance(value, float) and not math.isfinite(value) else value
