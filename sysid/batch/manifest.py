"""The manifest of a batch: logs, boards and tasks.

A TOML file with one `[[job]]` a job and `[defaults]` for all of them, or a CSV file with one row a job.
"""

import csv
import os
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from sysid.errors import SysidError, did_you_mean
from sysid.files import read_small

Task = Literal["decay", "fit", "compare", "diagnose"]
"""Task of a job, by the command's name."""


def _numbers(value: Any) -> tuple[float, ...]:
    return tuple(map(float, value if isinstance(value, list) else str(value).split(";")))


def _words(value: Any) -> tuple[str, ...]:
    items = value if isinstance(value, list) else str(value).split(";")
    return tuple(str(item).strip() for item in items)


def _flag(value: Any) -> bool:
    known = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
    return known[str(value).lower()]


READING: Mapping[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("column", "unit", "axis", "time-column", "source"), str),
    **dict.fromkeys(("rate", "from", "to"), float),
    **dict.fromkeys(("keep-outliers", "keep-zero"), _flag),
    "release": _numbers,
}
"""Options of reading by their names in the commands, and their kinds."""
READ_AS = {"from": "start", "to": "stop"}
"""Names in `Recording.read` that are other than in the commands."""
FIELDS: Mapping[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("name", "task", "board"), str),
    **dict.fromkeys(("logs", "effects"), _words),
    "together": _flag,
    **READING,
}
"""Fields of a job. In a table of text, lists are separated by ';'."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One thing to find out."""

    name: str
    task: Task
    logs: tuple[Path, ...]
    """Logs of one board, judged together."""
    board: str | None
    effects: tuple[str, ...] = ()
    """To add to those of the record, where it is fitted."""
    reading: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Arguments of `Recording.read`."""


def read_manifest(path: Path) -> list[Job]:
    """Read a manifest, TOML or CSV by its name; logs are looked for from its folder on.

    Raises:
        SysidError: It cannot be read, or says something unknown.
    """
    if not path.is_file():
        raise SysidError(
            f"{path}: there is no such manifest. Expected a .toml or a .csv file; see docs/batch.md."
        )
    try:
        text = read_small(path, "utf-8-sig")
        defaults: Mapping[str, Any] = {}
        if path.suffix.lower() == ".toml":
            rows, defaults = _toml(path, text)
        else:
            table = csv.DictReader(text.splitlines(), restkey="a cell beyond the header")
            rows = [{str(key).strip(): value for key, value in row.items() if value} for row in table]
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError, csv.Error) as error:
        raise SysidError(f"{path}: cannot be read as a manifest ({error}).") from error
    if not rows:
        raise SysidError(
            f"{path}: holds no job. Write one as [[job]] with its logs, or as a row of the table."
        )
    jobs = [job for number, row in enumerate(rows, 1) for job in _jobs(path, number, {**defaults, **row})]
    seen: dict[str, int] = {}
    for place, job in enumerate(jobs):
        first = seen.setdefault(job.name, place)
        if first != place:
            raise SysidError(f"{path}: two jobs are called '{job.name}'. Give one of them another name.")
    return jobs


def _toml(path: Path, text: str) -> tuple[list[Mapping[str, Any]], Mapping[str, Any]]:
    content = tomllib.loads(text)
    if unknown := [key for key in content if key not in ("defaults", "job")]:
        hint = did_you_mean(unknown[0], ("defaults", "job"))
        raise SysidError(
            f"{path}: unknown field '{unknown[0]}'.{hint} A manifest has [defaults] and [[job]]."
        )
    jobs, defaults = content.get("job", []), content.get("defaults", {})
    if not (isinstance(jobs, list) and all(isinstance(table, dict) for table in (defaults, *jobs))):
        raise SysidError(f"{path}: expected one table [defaults] and tables [[job]].")
    return jobs, defaults


def _jobs(path: Path, number: int, row: Mapping[str, Any]) -> list[Job]:
    """Return the jobs of a row: one a log, unless they are judged together."""
    where = f"{path}, job {number}"
    values: dict[str, Any] = {}
    for key, value in row.items():
        if key not in FIELDS:
            raise SysidError(
                f"{where}: unknown field '{key}'.{did_you_mean(key, FIELDS)} Known: {', '.join(FIELDS)}."
            )
        try:
            values[key] = FIELDS[key](value)
        except (ValueError, KeyError, TypeError):
            raise SysidError(
                f"{where}: field '{key}' is {value!r}; expected {_KINDS[FIELDS[key]]}."
            ) from None
    task = values.get("task", "decay")
    if task not in get_args(Task):
        raise SysidError(
            f"{where}: task is '{task}'.{did_you_mean(task, get_args(Task))} Known: {', '.join(get_args(Task))}."
        )
    if task != "decay" and "board" not in values:
        raise SysidError(f"{where}: '{task}' needs the board that was recorded. Add its name as 'board'.")
    if "effects" in values and task != "fit":
        raise SysidError(
            f"{where}: effects are added by 'fit' only. Leave them out, or ask for task = 'fit'."
        )
    logs = _logs(where, path.parent, values.get("logs", ()))
    reading = {
        READ_AS.get(name, name.replace("-", "_")): value for name, value in values.items() if name in READING
    }
    groups = [logs] if values.get("together", False) else [(log,) for log in logs]
    name, board, effects = values.get("name", ""), values.get("board"), values.get("effects", ())
    names = [name if name and len(groups) == 1 else f"{name} {group[0].name}".strip() for group in groups]
    return [
        Job(name=one, task=task, logs=group, board=board, effects=effects, reading=reading)
        for one, group in zip(names, groups, strict=True)
    ]


def _logs(where: str, folder: Path, patterns: tuple[str, ...]) -> tuple[Path, ...]:
    """Return the logs that patterns name, in order and each once.

    A pattern that names none stays as it is: the job that reads it fails, the others are done.
    """
    found: dict[Path, None] = {}
    for pattern in patterns:
        plain = Path(os.path.normpath(folder / pattern))
        base = Path(plain.anchor)
        matches = [] if plain.exists() else sorted(base.glob(str(plain.relative_to(base))))
        found.update(dict.fromkeys(matches or [plain]))
    if not found:
        raise SysidError(f"{where}: names no log. Add logs = ['monday/*.csv'].")
    return tuple(found)


_KINDS: Mapping[Callable[[Any], Any], str] = {
    str: "a text",
    float: "a number",
    _numbers: "numbers",
    _words: "a list of texts",
    _flag: "true or false",
}
