"""One job of a batch: read its logs, run its task, return a row of numbers."""

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from sysid.batch.manifest import Job
from sysid.board import find_record, load_named
from sysid.errors import SysidError
from sysid.files import sha256
from sysid.quantity import Quantity

QUANTITIES = {
    "stiffness": "nm_rad",
    "damping": "nms_rad",
    "omega_n": "rad_s",
    "damping_ratio": "",
    "log_decrement": "",
}
"""Quantities with columns of their own, and their units as in the columns' names."""
ENDS = ("", "low", "high")
"""The value, and the ends of its 95 % interval."""


def column(quantity: str, end: str = "") -> str:
    """Return the name of a quantity's column in the table, e.g. 'stiffness_low_nm_rad'."""
    return "_".join(filter(None, (quantity, end, QUANTITIES[quantity])))


COLUMNS = (
    "job", "task", "board", "logs", "state", *(column(name, end) for name in QUANTITIES for end in ENDS),
    "effects", "verdict", "confidence", "nrmse", "rmse_rad", "noise_rad", "warnings", "message", "seconds",
)  # fmt: skip
"""Of the table, in their order."""


def job_key(job: Job, workspace: Path) -> str:
    """Return a digest of a job's inputs: logs, record, task, options, and the tool's version.

    A log that is not there counts as nothing: its job fails, and failed jobs are tried again.

    Raises:
        SysidError: The board does not exist: a mistyped name stops the batch at once.
    """
    record = None if job.board is None else sha256(find_record(job.board, workspace))
    files = [
        f for log in job.logs for f in (sorted(log.rglob("*")) if log.is_dir() else [log]) if f.is_file()
    ]
    digests, options = [sha256(f) for f in files], sorted(job.reading.items())
    asked = [job.task, job.effects, options, record, digests, version("husky-sysid")]
    return hashlib.sha256(json.dumps(asked).encode()).hexdigest()


def run_job(job: Job, workspace: Path, key: str) -> dict[str, Any]:
    """Return the row of a job with its key; of a failed job, with its error."""
    begin = time.monotonic()
    row: dict[str, Any] = {
        "key": key, "job": job.name, "task": job.task, "board": job.board, "logs": [str(log) for log in job.logs],
    }  # fmt: skip
    try:
        row |= {"state": "done", "message": "", "result": _result(job, workspace)}
    except SysidError as error:
        row |= {"state": "failed", "message": str(error)}
    except Exception as error:  # noqa: BLE001  one log must not end a night's work
        row |= {"state": "failed", "message": f"a bug: {type(error).__name__}: {error}"}
    return {**row, "seconds": round(time.monotonic() - begin, 3)}


def _result(job: Job, workspace: Path) -> Mapping[str, Any]:
    from sysid.recording import Recording

    recordings = [Recording.read(log, **job.reading) for log in job.logs]
    board = None if job.board is None else load_named(job.board, workspace)
    if job.task == "decay" or board is None:
        from sysid.free_decay import fit_decay

        return fit_decay(recordings, board=board).to_json()
    if job.task == "fit":
        from sysid.fit_mjcf import fit

        return fit(recordings, board, job.effects).to_json()
    if job.task == "compare":
        from sysid.comparison.compare import compare

        return compare(recordings, board).to_json()
    from sysid.diagnosis.diagnose import diagnose

    return diagnose(recordings, board).to_json()


def failure(row: Mapping[str, Any]) -> str:
    """Return which job failed and why; a message begins with the log as a rule, which may be the job's name."""
    begin = f"{row['job']}: "
    return begin + row["message"].removeprefix(begin)


def with_interval(row: Mapping[str, Any], name: str) -> str:
    """Return 'value ± half-width of the 95 % interval' of a quantity in a row of the table; '-' without one."""
    if column(name) not in row:
        return "-"
    value, low, high = (row[column(name, end)] for end in ENDS)
    return str(Quantity(value, 0.0, "1", interval=(low, high)))


def table_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of the table, by `COLUMNS`, with the results of the task."""
    result = row.get("result", {})
    quantities = {**result, **result.get("parameters", {})}
    cells: dict[str, Any] = {
        name: row[name] for name in ("job", "task", "board", "state", "message", "seconds")
    }
    for name in QUANTITIES:
        found = quantities.get(name)
        if isinstance(found, Mapping) and found["value"] is not None:
            values = (found["value"], *found["ci95"])
            cells |= {column(name, end): value for end, value in zip(ENDS, values, strict=True)}
    verdict = result.get("verdict", {})
    status = result.get("residual", {}).get("status")
    if "passed" in result:
        status = "matches" if result["passed"] else "differs"
    cells |= {
        "logs": "; ".join(row["logs"]),
        "effects": ", ".join(verdict.get("effects", result.get("effects", ()))),
        "verdict": verdict.get("status", status),
        "confidence": verdict.get("confidence"),
        "nrmse": result.get("nrmse"),
        "rmse_rad": result.get("rmse_rad", verdict.get("error_before_rad")),
        "noise_rad": result.get("noise_floor_rad"),
        "warnings": len(result.get("warnings", ())),
    }
    return {name: cells[name] for name in COLUMNS if cells.get(name) not in (None, "")}


def unfinished(
    jobs: Sequence[Job], workspace: Path, rows: Sequence[Mapping[str, Any]]
) -> tuple[list[tuple[Any, ...]], list[dict[str, Any]]]:
    """Return the arguments of `run_job` for open jobs, and the rows of finished ones, under the jobs' own names."""
    done = {row["key"]: row for row in rows if row["state"] == "done"}
    waiting: list[tuple[Any, ...]] = []
    kept: list[dict[str, Any]] = []
    for job in jobs:
        key = job_key(job, workspace)
        if key in done:
            kept.append({**done[key], "job": job.name, "logs": [str(log) for log in job.logs]})
        else:
            waiting.append((job, workspace, key))
    return waiting, kept
