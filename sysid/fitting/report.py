"""A fit in words, tables and JSON."""

from collections.abc import Sequence
from math import floor, isfinite, log10
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.fitting.covariance import known_together, table_values
from sysid.quantity import Z95
from sysid.text import WIDTH, count, display, table

if TYPE_CHECKING:
    from sysid.fit_mjcf import Fit
    from sysid.fitting.bootstrap import Bootstrap
    from sysid.fitting.intervals import Agreement
    from sysid.fitting.profile import Profile
    from sysid.fitting.result import JointFit


def report(fit: "Fit", width: int = WIDTH) -> str:
    """Return the quantities before and after, and the errors from the linear joint up."""
    show = display(is_rate=fit.is_rate, slides=fit.before.slides)
    values = table_values(fit.law.structure)
    known = fit.before.quantities
    quantities = table(
        ("quantity", "before", "after ± 95 %"),
        [
            (name, str(known.get(name, "-")), str(quantity))
            for name, quantity in fit.quantities.items()
            if name not in values
        ],
        width=width,
    )
    rungs = table(
        ("model", "error", "held out", "error / noise"),
        [
            (rung.label, show(rung.rmse), show(rung.heldout_rmse), f"{rung.rmse / fit.noise.std:.3f}")
            for rung in fit.ladder
        ],
        width=width,
    )
    heading = (
        f"{fit.before.name} · {count(len(fit.joint.records), 'release')} · {fit.status} · sensor noise "
        f"{show(fit.noise.std, 3)}, {fit.noise.how}"
    )
    several = len(fit.joint.records) > 1
    unseen = (
        "releases that the fit had not seen"
        if several
        else "the release's second half, predicted from its first"
    )
    lines = (
        heading,
        quantities,
        *_poses(fit, width),
        rungs,
        f"held out: error on {unseen}",
        f"record as it stood: error {show(fit.rmse_before)}",
    )
    return "\n".join((*lines, *learned_lines(fit)))


def learned_lines(fit: "Fit") -> list[str]:
    """Return the learned torque in words: its range, its nearest formula, and how to make it an effect."""
    part = next((part for part in fit.law.structure.torques if part.smoothness), None)
    if part is None:
        return []
    values = part.named(dict(fit.law.effects)[part.name])
    low, high, slow, fast = (values[name] for name in part.support)
    lines = [
        f"learned from {np.degrees(low):.3g}° to {np.degrees(high):.3g}° and from {slow:.3g} to {fast:.3g} rad/s; "
        "beyond that range the torque stays as it is at the edge"
    ]
    formula = fit.formula
    if formula is not None:
        known = f". Fit it: --effect {' --effect '.join(formula.effects)}" if formula.effects else ""
        good = (
            f"the formula is as likely as the table{known}"
            if formula.good
            else "the table is likelier than the formula"
        )
        lines += [f"Learned torque: {formula.text}", good]
    return lines


def _poses(fit: "Fit", width: int) -> list[str]:
    """Say what several poses and loads fix that each of them alone leaves open."""
    together = known_together(fit.joint.problem, fit.joint.minimum)
    if not together:
        return []

    def share(name: str, std: float) -> str:
        wide = Z95 * std / max(abs(fit.quantities[name].value), 1e-300)
        return f"± {100 * wide:.2g} %" if wide < 1 else "open"

    rows = [(name, share(name, alone), share(name, whole)) for name, (whole, alone) in together.items()]
    return [table(("quantity", "best pose alone", "all poses"), rows, width=width)]


def to_json(fit: "Fit") -> dict[str, Any]:
    """Return the result of the command: SI, radians, each quantity with its interval."""
    # An error of a measured rate, as the amplitude of a swing at the joint's frequency that has that rate.
    per = 1.0 / fit.law.frequency if fit.is_rate else 1.0
    bounds = {name: list(ends) for name, ends in fit.options.bounds.items()}
    asked = {"fixed": dict(fit.options.fixed), "bounds": bounds}
    return {
        "board": fit.before.name,
        "effects": [name for name, _ in fit.law.effects],
        "inertia": fit.before.inertia.to_json(),
        "parameters": {name: quantity.to_json() for name, quantity in fit.quantities.items()},
        "correlation": {
            "names": list(fit.quantities),
            "matrix": np.nan_to_num(fit.joint.correlation).tolist(),
        },
        "rmse_rad": per * fit.rmse,
        "nrmse": fit.joint.nrmse,
        "heldout_rmse_rad": per * fit.heldout_rmse,
        "noise_floor_rad": per * fit.noise.std,
        "signal": "rate" if fit.is_rate else "roll",
        "rmse_before_rad": per * fit.rmse_before,
        "ladder": [
            {"model": r.label, "rmse_rad": per * r.rmse, "heldout_rmse_rad": per * r.heldout_rmse}
            for r in fit.ladder
        ],
        **{name: values for name, values in asked.items() if values},
        **({"learned": _learned_json(fit)} if fit.joint.problem.smoothing else {}),
        "status": fit.status,
        "warnings": list(fit.warnings),
    }


def _learned_json(fit: "Fit") -> dict[str, Any]:
    formula = fit.formula
    return {
        "error_after_rad": fit.rmse,
        "heldout_rmse_rad": fit.heldout_rmse,
        "formula": None if formula is None else [shape.name for shape in formula.shapes],
        "share": None if formula is None else formula.share,
        "as_good": formula is not None and formula.good,
        "text": "nothing was learned" if formula is None else formula.text,
    }


def interval_report(
    fit: "JointFit",
    profiles: "Sequence[Profile]",
    bootstrap: "Bootstrap | None",
    agreements: "Sequence[Agreement]",
    width: int = WIDTH,
) -> str:
    """Return the 95 % intervals of a fit, from each method side by side, and which to trust."""
    columns = ["95 % interval", "Jacobian"]
    columns += (["profile"] if profiles else []) + ([bootstrap.how] if bootstrap else [])
    by_name = {shape.name: shape for shape in profiles}
    rows: list[list[str]] = []
    for name, quantity in fit.quantities.items():
        row = [name, _interval(quantity.ci95, quantity.std)]
        if profiles:
            row.append(_interval(by_name[name].interval, quantity.std) if name in by_name else "-")
        if bootstrap:
            row.append(_interval(bootstrap.intervals[name], quantity.std))
        rows.append(row)
    trust = (f"{one.name}: trust the {one.trust}'s interval: {one.text}" for one in agreements)
    return "\n".join((table(columns, rows, width=width), *trust))


def interval_json(
    profiles: "Sequence[Profile]", bootstrap: "Bootstrap | None", agreements: "Sequence[Agreement]"
) -> dict[str, Any]:
    """Return the JSON of `fit --profile` and `fit --bootstrap`."""
    return {
        **({"profile": {shape.name: shape.to_json() for shape in profiles}} if profiles else {}),
        **({"bootstrap": bootstrap.to_json()} if bootstrap else {}),
        "intervals": [
            {
                "name": one.name,
                "trust": one.trust,
                "ci95": [end if isfinite(end) else None for end in one.interval],
                "text": one.text,
            }
            for one in agreements
        ],
    }


def _interval(interval: tuple[float, float], error: float) -> str:
    """Print an interval to a tenth of its deviation."""
    decimals = max(0, 1 - floor(log10(error))) if error > 0 and isfinite(error) else 4
    low, high = (f"{end:.{decimals}f}" if isfinite(end) else "open" for end in interval)
    return f"{low} … {high}"
