"""A comparison in words, tables and JSON."""

from typing import TYPE_CHECKING, Any

from sysid.comparison.backbone import Backbone
from sysid.roll import Array
from sysid.text import WIDTH, table

if TYPE_CHECKING:
    from sysid.comparison.compare import Comparison
    from sysid.diagnosis.demand import Demand


def report(result: "Comparison", width: int = WIDTH) -> str:
    """Return the error of each release, of all, its location, and the verdict."""
    show = result.show
    releases = table(
        ("release", "error", "error / noise"),
        [(r.name, show(r.rmse), f"{r.rmse / result.noise.std:.2f}") for r in result.releases],
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
        else {"over_angle": _profile(missing, missing.angle), "over_rate": _profile(missing, missing.rate)},
        "backbone": {
            "measured": _backbone(result.measured_backbone),
            "simulated": _backbone(result.simulated_backbone),
        },
        "passed": result.passed,
        "tolerance": result.tolerance,
    }


def _profile(missing: "Demand", at: Array) -> dict[str, list[float]]:
    profile = missing.over(at)
    return {"at": profile.at.tolist(), "torque_nm": profile.torque.tolist(), "std_nm": profile.std.tolist()}


def _backbone(backbone: Backbone) -> dict[str, list[float]]:
    return {
        "amplitude_rad": backbone.amplitude.tolist(),
        "period_s": backbone.period.tolist(),
        "damping_ratio": backbone.damping_ratio.tolist(),
    }
