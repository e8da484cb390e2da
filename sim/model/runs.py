"""Several logs of one joint, each in its own pose or with its own load: a list in TOML."""

import tomllib
from pathlib import Path
from typing import Any

from sim.model.setup import Payload, Setup
from sysid.errors import SysidError, did_you_mean

FIELDS = ("file", "keyframe", "pose", "payload")


def read_runs(path: Path, setup: Setup) -> list[tuple[Path, Setup]]:
    """Read a list of logs: `[[log]]` with `file`, and other `keyframe`, `pose` or `payload`.

    Args:
        path: The list; files count from its folder.

    Raises:
        SysidError: It cannot be read, or a field is missing, unknown or of another kind.
    """
    try:
        raw: Any = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SysidError(f"{path}: cannot read the list of logs ({error}).") from error
    entries = raw.get("log")
    if not isinstance(entries, list) or not entries:
        raise SysidError(
            f"{path}: expected tables [[log]] with file, and keyframe, pose or payload where they differ."
        )
    return [_run(path, number, entry, setup) for number, entry in enumerate(entries, start=1)]


def _run(path: Path, number: int, entry: Any, setup: Setup) -> tuple[Path, Setup]:
    where = f"{path}: log {number}"
    for key in entry:
        if key not in FIELDS:
            raise SysidError(
                f"{where}: unknown field '{key}'.{did_you_mean(key, FIELDS)} Known: {', '.join(FIELDS)}."
            )
    file, pose, payload = entry.get("file"), entry.get("pose", {}), entry.get("payload", [])
    if not isinstance(file, str):
        raise SysidError(f"{where}: field file is {file!r}; expected the log.")
    if not isinstance(pose, dict) or not all(isinstance(value, int | float) for value in pose.values()):
        raise SysidError(f"{where}: field pose is {pose!r}; expected {{ JOINT = POSITION }} in rad or m.")
    if not isinstance(payload, list) or not all(isinstance(text, str) for text in payload):
        raise SysidError(f"{where}: field payload is {payload!r}; expected a list of MASS@WHERE.")
    return path.parent / file, setup.with_(
        keyframe=entry.get("keyframe", setup.keyframe),
        pose={**setup.pose, **pose},
        payload=(*setup.payload, *map(Payload.parse, payload)),
    )
