"""Everything known of a board, for reports and pictures: its record, its logs, the comparison and the errors of the models."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from reports.log_files import LogFile
from sysid.board import Board
from sysid.comparison.compare import Comparison, compare
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.files import regular
from sysid.fitting.joint import FitOptions
from sysid.fitting.ladder import Rung, ladder, rung_name
from sysid.fitting.records import signal_of
from sysid.fitting.result import JointFit
from sysid.joint import JointLaw
from sysid.progress import stage
from sysid.recording import Recording
from sysid.roll import Release
from sysid.workspace import Workspace


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """A board and the results of its logs."""

    board: Board
    releases: tuple[Release, ...]
    comparison: Comparison
    stood: JointLaw
    """The board's law before it was first changed in this workspace; its present one if it never was."""
    files: tuple[LogFile, ...] = ()
    ladder: tuple[Rung, ...] = ()
    """From spring and damper up to all effects of the board."""
    fit: JointFit | None = None
    """The last rung in full; None where the board's law cannot be fitted to these logs."""
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class LastDiagnosis:
    """Result of the last `husky-sysid diagnose` for a board."""

    content: Mapping[str, Any]
    """Of its diagnose.json."""
    is_current: bool
    """Whether the record is still the one that was diagnosed."""


def last_diagnosis(board: Board, space: Workspace) -> LastDiagnosis | None:
    """Return the board's last diagnosis, if there is one."""
    try:
        path = regular(space.outputs(board.name) / "diagnose.json")
        content: Any = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(content, dict) or not {"verdict", "best", "candidates"} <= set(content):
        return None
    return LastDiagnosis(content, content.get("record") == board.digest)


def gather(
    board: Board,
    recordings: Sequence[Recording],
    *,
    files: Sequence[LogFile] = (),
    tolerance: float = 0.02,
    stood: Board | None = None,
) -> Evidence:
    """Compare a board with recordings, and fit the ladder of models up to its law.

    Args:
        stood: The record before it was first changed; `board` if left out.

    Raises:
        SysidError: The board's law cannot be compared with these releases.
    """
    releases = [release for recording in recordings for release in recording.releases]
    options = FitOptions(**signal_of(releases))
    warnings = [warning for recording in recordings for warning in recording.roll.warnings]
    with stage(0.0, 0.2, "comparing"):
        compared = compare(recordings, board, tolerance=tolerance)
    names = [part.name for part in board.effects]
    added = [name for name in names if not effect(name).is_known]
    rungs: list[Rung] = []
    models = ladder(releases, board, names, options)
    try:
        with stage(0.2, 1.0):
            for rung in models:
                rungs.append(rung)
    except SysidError as error:
        warnings.append(f"the ladder stops before '{rung_name(added[: len(rungs)])}': {error}")
    fit = rungs[-1].fit if len(rungs) == len(added) + 1 else None
    if fit is not None:
        warnings += fit.warnings
    return Evidence(
        board=board,
        files=tuple(files),
        releases=tuple(releases),
        comparison=compared,
        ladder=tuple(rungs),
        fit=fit,
        # A new record has neither spring nor damper before its first fit: no law at all.
        stood=JointLaw.from_board(
            stood if stood and (stood.stiffness or stood.damping or stood.effects) else board
        ),
        warnings=tuple(dict.fromkeys(warnings)),
    )
