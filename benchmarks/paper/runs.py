"""The manifest of runs: which command made which weights (`data/policies/runs.toml`, or one's own)."""

import csv
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from policy_runtime.learning.run_folder import RunFolder
from sysid.errors import SysidError
from sysid.files import shipped_data


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One trained policy."""

    name: str
    row: str
    """Row of the paper's tables that it stands for, see `paper.published`; '' for none."""
    board: str
    command: str
    """What made it."""
    note: str = ""
    """What a reader of its row must know."""
    policy: Path | None = None
    """ONNX file; None where only curves are kept."""
    curves: Path | None = None
    """CSV as `data/policies/join_curves.py` writes it, or the `curves.jsonl` of a run's folder."""

    def read_curves(self) -> list[dict[str, float]]:
        """Return one dictionary an iteration; empty where no curves are kept.

        Raises:
            SysidError: The file cannot be read.
        """
        if self.curves is None:
            return []
        if self.curves.suffix == ".jsonl":
            return RunFolder(self.curves.parent).read_curves()
        try:
            with self.curves.open(newline="", encoding="utf-8") as file:
                return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
        except (OSError, ValueError) as error:
            raise SysidError(
                f"{self.curves}: cannot be read as curves ({error}). Expected numbers, one row an iteration."
            ) from error


def load_runs(path: Path | None = None) -> list[Run]:
    """Read a manifest: tables [[run]] with name, board, command, and either 'folder' or 'policy' and 'curves'.

    Args:
        path: The file; the shipped one if None. Paths in it are relative to it.

    Raises:
        SysidError: It cannot be read, an entry lacks something, or a file that it names is missing.
    """
    path = path or shipped_data() / "policies" / "runs.toml"
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SysidError(
            f"{path}: cannot be read ({error.strerror}). Expected a manifest of runs."
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SysidError(f"{path}: not a TOML file ({error}).") from error
    return [_run(path, number, entry) for number, entry in enumerate(raw.get("run", []), start=1)]


def _run(path: Path, number: int, entry: dict[str, Any]) -> Run:
    where = f"{path}: run {number} ('{entry.get('name', '')}')"
    known = {"name", "row", "board", "command", "note", "folder", "policy", "curves"}
    for key in ("name", "board", "command"):
        if not isinstance(entry.get(key), str):
            raise SysidError(f"{where}: '{key}' is missing; expected a text.")
    for key in entry.keys() - known:
        raise SysidError(f"{where}: '{key}' is unknown. Known: {', '.join(sorted(known))}.")
    files = {key: path.parent / entry[key] for key in ("policy", "curves") if key in entry}
    if "folder" in entry:
        folder = RunFolder(path.parent / entry["folder"])
        files = {"policy": folder.policy, "curves": folder.curves} | files
    for key, file in files.items():
        if not file.is_file():
            raise SysidError(f"{where}: {key} {file} is not there.")
    return Run(
        name=entry["name"],
        row=entry.get("row", ""),
        board=entry["board"],
        command=entry["command"],
        note=entry.get("note", ""),
        policy=files.get("policy"),
        curves=files.get("curves"),
    )
