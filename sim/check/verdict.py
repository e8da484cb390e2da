"""The verdict of the gate in words, tables and JSON: failures, their causes, and warnings."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from typing import Any

from sim.board.clamped import ClampedScene
from sim.check.decays import check_scene
from sim.check.rules import Case, said
from sim.compensation.parasitics import DECK, TiltJoint, measure_parasitics
from sysid.board import Board
from sysid.roll import Release
from sysid.shown import Shown
from sysid.text import WIDTH, table

ROUNDING = 1e-6
"""Parts below this share of the board's own stiffness, damping or inertia are rounding [1]: poles are measured to 1e-8."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Verdict(Shown):
    """Verdict of `check` on a scene."""

    case: Case
    against: tuple[str, ...]
    """Failures; empty for a pass."""
    reasons: tuple[str, ...]
    """Likely causes of a failure."""
    warnings: tuple[str, ...]
    """Warnings of a pass."""

    @property
    def passed(self) -> bool:
        """Whether there is no failure."""
        return not self.against

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on stretches that were left out."""
        return tuple(
            f"{one.release.log}, release {one.release.number}: the first {1e3 * one.cut:.0f} ms are beyond the scene's "
            f"tilt range of ±{self.case.scene.tilt_range:.3g} rad and are left out"
            for one in self.case.decays.releases
            if one.cut > 0
        )

    def entry(self) -> dict[str, Any]:
        """Return the verdict as a record's [check] section holds it; see `Board.checked`."""
        decays = self.case.decays
        return {
            "passed": self.passed,
            "nrmse": float(f"{decays.nrmse:.4g}"),
            "tolerance": decays.tolerance,
            "scene": self.case.scene.name,
            "logs": list(dict.fromkeys(one.release.log for one in decays.releases)),
            "date": date.today().isoformat(),
        }

    def brief(self) -> str:
        """Return the verdict, the error and the scene."""
        decays = self.case.decays
        head = f"{'passed' if self.passed else 'not passed'}: NRMSE {100 * decays.nrmse:.2f} %, {100 * decays.tolerance:g} % allowed"
        lines = [
            f"Check of {self.case.board.name} in {self.case.scene.name}",
            f"  {head}",
            *([] if self.passed else [f"  {self.refusal()}"]),
        ]
        return "\n".join(lines)

    def refusal(self) -> str:
        """Return the failures and their causes as sentences."""
        why = "; ".join(self.reasons) or (
            f"no part of the scene stands out. If the logs are of another {self.case.kind} than '{self.case.board.name}', name that "
            f"with --{self.case.kind}; else fit the {self.case.kind} to them, or diagnose them"
        )
        return f"{'; '.join(self.against)}. Why: {why}."

    def report(self, width: int = WIDTH) -> str:
        """Return tables of each decay's error and of the scene's tilt joint, and a line for a pass."""
        decays, joint = self.case.decays, self.case.parts
        rows: list[tuple[str, ...]] = []
        for one in decays.releases:
            errors = (
                f"{100 * one.nrmse:.2f} %",
                f"{1e3 * one.rmse:.2f} {'mm' if self.case.board.slides else 'mrad'}",
            )
            measured, length = one.release, one.release.time[-1] - one.release.time[0]
            side = one.side if joint is not None else {"right": "above", "left": "below"}[one.side]
            rows.append((measured.log, str(measured.number), side, f"{length:.2f} s", *errors))
        held = "all but the joint" if joint is None else "the chassis"
        lines = [
            f"{self.case.kind} {self.case.board.name} in: {self.case.scene.name}; {held} is held, as on a bench",
            table(("log", "release", "from", "to compare", "NRMSE", "RMSE with noise"), rows, width=width),
        ]
        if joint is not None:
            of = [("wanted at this step", joint.wanted), ("the scene as a whole", joint.whole)]
            of += [(name if name == DECK else f"contribution of {name}", part) for name, part in joint.parts]
            parts = [(name, *(f"{value:.4g}" for value in _rounded(part, joint.wanted))) for name, part in of]
            head = ("tilt joint", "stiffness N·m/rad", "damping N·m·s/rad", "inertia kg·m²")
            lines.append(table(head, parts, width=width))
        if self.passed:
            hidden = 100 * decays.hidden
            lines.append(
                f"passed: NRMSE {100 * decays.nrmse:.2f} % (tolerance {100 * decays.tolerance:g} %; the noise hides "
                f"errors up to {hidden:{'.1f' if hidden >= 0.05 else '.1g'}} %)"
            )
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """Return the result of `husky-sysid check --json`."""
        decays, joint = self.case.decays, self.case.parts
        return {
            "board": self.case.board.name,
            "scene": self.case.scene.name,
            "passed": self.passed,
            "nrmse": decays.nrmse,
            "tolerance": decays.tolerance,
            "nrmse_hidden_by_noise": decays.hidden,
            "rmse_rad": decays.rmse,
            "releases": [
                {
                    "log": one.release.log,
                    "release": one.release.number,
                    "side": one.side,
                    "t_start_s": float(one.release.time[0]),
                    "t_end_s": float(one.release.time[-1]),
                    "left_out_s": one.cut,
                    "nrmse": one.nrmse,
                    "rmse_rad": one.rmse,
                    "zero_rad": one.zero,
                    "rest_error_rad": one.rest_error,
                }
                for one in decays.releases
            ],
            "tilt_joint": None
            if joint is None
            else {
                "wanted": _numbers(joint.wanted),
                "whole": _numbers(joint.whole),
                "parts": {name: _numbers(part) for name, part in joint.parts},
            },
            "reasons": list(self.reasons),
        }


def judge(
    board: Board, scene: ClampedScene, releases: Sequence[Release], *, tolerance: float = 0.02
) -> Verdict:
    """Release the deck in a scene as in the logs, and judge the scene.

    Raises:
        SysidError: No decay stays within the scene's tilt range for long enough, or the scene does not move.
    """
    case = Case(
        board=board, scene=scene, decays=check_scene(board, scene, releases, tolerance=tolerance),
        parts=measure_parasitics(board, scene) if board.geometry else None,
    )  # fmt: skip
    against = said("failures", case)
    return Verdict(
        case=case, against=against, reasons=said("causes", case) if against else (),
        warnings=() if against else said("warnings", case),
    )  # fmt: skip


def _rounded(part: TiltJoint, wanted: TiltJoint) -> list[float]:
    pairs = zip(part, wanted, strict=True)
    return [0.0 if abs(value) < ROUNDING * abs(own) else value for value, own in pairs]


def _numbers(joint: TiltJoint) -> dict[str, float]:
    return {
        "stiffness_nm_rad": joint.stiffness,
        "damping_nms_rad": joint.damping,
        "inertia_kgm2": joint.inertia,
    }
