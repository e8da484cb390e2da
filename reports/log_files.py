"""Logs of a record: present files, with their state and truth."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.board import Board
from sysid.errors import SysidError
from sysid.files import regular, sha256
from sysid.workspace import Workspace


@dataclass(frozen=True, slots=True)
class LogFile:
    """A log that the record names, or that was given."""

    path: str
    """As it was named."""
    found: Path | None
    """Present path; None if it is gone."""
    digest: str
    """SHA-256 of the present file, or the recorded one if it is gone."""
    state: str
    """In words: as fitted, changed, gone, or not part of the fit."""
    synthetic: bool = False
    """Whether the file of its truth lies beside it."""


def find_logs(board: Board, given: Sequence[Path], space: Workspace) -> list[LogFile]:
    """Return the logs to look at: those given, or else those that the record was fitted to.

    A recorded path counts from the workspace; one of an older record from the folder in which it was written.
    """
    entries = list(board.fit.get("logs", []))
    if given:
        known = {str(entry.get("sha256")) for entry in entries}
        files: list[LogFile] = []
        for path in given:
            if not path.exists():
                raise SysidError(f"{path}: there is no such file.")
            digest = _digest(path)
            state = "as fitted" if digest in known else "not part of the recorded fit"
            files.append(LogFile(str(path), path, digest, state, _is_synthetic(path)))
        return files
    return [_recorded(str(entry.get("path", "")), str(entry.get("sha256", "")), space) for entry in entries]


def _recorded(name: str, digest: str, space: Workspace) -> LogFile:
    there = [path for path in (space.recorded(name), Path(name)) if name and path.exists()]
    digests = [_digest(path) for path in there]
    if digest in digests:
        path = there[digests.index(digest)]
        return LogFile(name, path, digest, "as fitted", _is_synthetic(path))
    if there:
        return LogFile(name, None, digests[0], "changed since the fit: not used")
    return LogFile(name, None, digest, "gone: only the record speaks of it")


def _digest(path: Path) -> str:
    return sha256(path) if path.is_file() else ""


def _is_synthetic(path: Path) -> bool:
    """Return whether a log was made by `synth`: its truth lies beside it."""
    beside = path.with_suffix(".truth.json")
    try:
        content: Any = json.loads(regular(beside).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get("synthetic") is True
