"""A comparison in words, tables and JSON."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.comparison.backbone import Backbone
from sysid.text import WIDTH, table

if TYPE_CHECKING:
    from sysid.comparison.compare import Comparison


def report(result: "Comparison", width: int = WIDTH) -> str:
    """Return the error of each release, of all, its location, and the verdict."""
    show = result.show
    releases = table(
        ("release", "error", "error / noise"),
        [
            (f"{Path(r.log).name} {r.number}", show(r.rmse), f"{r.rmse / result.noise.std:.2f}")
            for r in result.releases
        ],
        width=width,
    )
    lines = [
        releases,
        f"error {show(result.rmse)} = {100 * result.nrmse:.2f} % of the RMS motion; sensor noise "
        f"{show(result.noise.std)}, {result.noise.how}",
        result.summary,
        f"{'✓' if result.passed else '✗'} {result.status}: {result.verdict()}",
    ]
    return "\n".join(lines)


def to_json(result: "Comparison") -> dict[str, Any]:
    """Return the binding result of the command."""
    # The error of a rate becomes that of an angle: divided by the joint's frequency.
    per = 1.0 / result.law.frequency if result.is_rate else 1.0
    missing, heldout = result.missing, result.heldout_rmse
    logs = [str(recording.path) for recording in result.recordings]
    return {
        "board": result.board,
        "logs": logs or list(dict.fromkeys(release.log for release in result.releases)),
        "rmse_rad": per * result.rmse,
        "nrmse": result.nrmse,
        "nrmse_beyond_noise": result.excess,
        "nrmse_beyond_noise_ci95": list(result.excess_range),
        "noise_floor_rad": per * result.noise.std,
        "noise_floor_how": result.noise.how,
        "heldout_rmse_rad": per * heldout if heldout is not None else None,
        "signal": "rate" if result.is_rate else "roll",
        "releases": [{"log": r.log, "number": r.number, "rmse_rad": per * r.rmse} for r in result.releases],
        "where": [
            {"axis": p.axis, "range": list(p.range), "share_of_error": p.share, "text": p.text}
            for p in result.where
        ],
        "summary": result.summary,
        "missing_torque": None
        if missing is None
        else {
            "angle_edges_rad": missing.angle.tolist(),
            "rate_edges_rad_s": missing.rate.tolist(),
            "torque_nm": [[v if np.isfinite(v) else None for v in row] for row in missing.torque.tolist()],
            "samples": missing.count.tolist(),
            **{
                axis: {
                    "at": profile.at.tolist(),
                    "torque_nm": profile.torque.tolist(),
                    "std_nm": profile.std.tolist(),
                }
                for axis, profile in (("over_angle", missing.over_angle), ("over_rate", missing.over_rate))
            },
        },
        "backbone": {
            "measured": _backbone(result.measured_backbone),
            "simulated": _backbone(result.simulated_backbone),
        },
        "passed": result.passed,
        "tolerance": result.tolerance,
    }


def _backbone(backbone: Backbone) -> dict[str, list[float]]:
    return {
        "amplitude_rad": backbone.amplitude.tolist(),
        "period_s": backbone.period.tolist(),
        "damping_ratio": backbone.damping_ratio.tolist(),
    }
