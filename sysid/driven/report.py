"""Fits and verdicts of driven joints in words."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from sysid.driven.diagnose import DrivenVerdict, next_experiment
from sysid.driven.fit import DrivenFit
from sysid.driven.runs import Agreement
from sysid.effects import DriveEffect, effect
from sysid.text import table


def verdict_text(verdict: DrivenVerdict, joint: str) -> str:
    """Return a verdict in words."""
    names = " and ".join(verdict.effects)
    heads = {
        "missing": f"Result: {names} {'is' if len(verdict.effects) == 1 else 'are'} missing (confidence {100 * verdict.confidence:.0f} %)",
        "none-missing": "Result: no effect is missing",
        "unexplained": f"Result: unexplained error{f'; {names} explains a part' if names else ''}",
    }
    lines = [f"{joint}, {Path(verdict.base.log.name).name}: {heads[verdict.status]}"]
    before, after = (100 * one.nrmse for one in (verdict.base, verdict.best))
    lines.append(
        f"  error beyond the noise: {before:.2f} % of the motion with the model as it is, {after:.2f} % with it"
    )
    lines += [f"  {name} = {quantity}" for name, quantity in verdict.best.quantities.items()]
    if verdict.alike:
        lines.append(f"  fits as well: {'; '.join(' and '.join(one) or 'nothing' for one in verdict.alike)}")
    if verdict.effects:
        for part in map(effect, verdict.effects):
            own = part.does if isinstance(part, DriveEffect) else f"{part.title}, {part.law}"
            lines.append(f"  {part.name}: {own}")
        lines.append(f"  to be sure: {next_experiment(verdict)}")
    return "\n".join(lines)


def fit_text(joint: str, fits: Sequence[DrivenFit], merged: Agreement, before: Mapping[str, float]) -> str:
    """Return the fit of a joint as a table, and how its logs agree."""
    several = len(fits) > 1
    head = ["parameter", "model", "value ± 95 %"]
    head += [*(Path(one.log.name).name for one in fits), "agree"] if several else []
    rows: list[list[str]] = []
    for name, quantity in merged.combined.quantities.items():
        old = before.get(name)
        row = [
            name,
            "-" if old is None else f"{old:.4g}",
            str(quantity) if math.isfinite(quantity.std) else "open",
        ]
        if several:
            row += [str(one.quantities[name].number) for one in fits]
            cause = merged.causes.get(name, "")
            differs = f"no, goes with {cause}" if cause else "no"
            row.append("open" if name in merged.loose else differs if name in merged.differs else "yes")
        rows.append(row)
    lines = [
        table(head, rows, f"{joint}: driven by a {fits[0].log.kind}, {fits[0].log.between} between samples")
    ]
    for one in fits:
        lines.append(f"{Path(one.log.name).name}: {100 * one.nrmse:.2f} % of the motion beyond the noise")
        if not one.is_noise:
            lines.append(
                "  the error that is left is no noise: an effect is missing. The intervals are wider for it"
            )
    if several and merged.loose:
        lines.append(
            f"no log fixes {', '.join(merged.loose)}. The most informative log is {Path(fits[merged.helps].log.name).name}"
        )
    return "\n".join(lines)
