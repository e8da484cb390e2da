"""Which columns of a log belong to which joint: by name, by a list beside the log, or by order."""

import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sysid.errors import SysidError

MOTIONS = (
    "q",
    "qpos",
    "pos",
    "position",
    "joint_pos",
    "joint_positions",
    "observation.state",
    "actual_q",
    "present_position",
)
"""Loggers' names for measured positions, the likeliest first."""
INPUTS = {
    "command": (
        "action",
        "ctrlData",
        "q_des",
        "q_target",
        "target",
        "cmd",
        "command",
        "goal_position",
        "ctrl",
    ),
    "torque": ("tau", "tau_est", "torque", "effort"),
    "force": ("force", "effort"),
    "current": ("current", "present_current", "iq"),
    "voltage": ("voltage", "pwm", "present_pwm"),
}
"""Loggers' names for the inputs of each kind."""


def plain(name: str) -> str:
    """Return a name in lower case, without punctuation, units in brackets and joints' endings."""
    bare = re.sub(r"\(.*?\)|/ ?\w+$|(?<=_)(rad|deg|nm|s|a|v)$", "", name.lower())
    return re.sub(r"[^a-z0-9]+", "_", bare).strip("_").removesuffix("_joint")


def columns_of_joints(
    names: Sequence[str], joints: Sequence[str], prefixes: Sequence[str], listed: Sequence[str] = ()
) -> dict[str, str]:
    """Return the column of each joint; empty if every prefix misses a joint.

    Args:
        names: Columns of the log.
        joints: Names of the joints, in the model's order.
        prefixes: Names of the quantity, the likeliest first.
        listed: Names of the numbered columns in order, where a file beside the log says them.
    """
    for prefix in prefixes:
        start = plain(prefix)
        rest = {
            plain(name).removeprefix(start).strip("_"): name
            for name in names
            if plain(name).startswith(start)
        }
        rest |= {
            plain(name).removesuffix(start).strip("_"): name
            for name in names
            if plain(name).endswith(f"_{start}")
        }
        rest |= {key.removesuffix("_pos"): name for key, name in rest.items()}  # LeRobot's endings
        found = {joint: rest[plain(joint)] for joint in joints if plain(joint) in rest}
        if len(found) == len(joints):
            return found
        numbered = sorted((int(key), name) for key, name in rest.items() if key.isdigit())
        order = [plain(one) for one in listed]
        if len(order) == len(numbered) and set(map(plain, joints)) <= set(order):
            return {joint: numbered[order.index(plain(joint))][1] for joint in joints}
        if len(numbered) == len(joints):
            return {joint: name for joint, (_, name) in zip(joints, numbered, strict=True)}
    return {}


def column_of(names: Sequence[str], joint: str, prefixes: Sequence[str]) -> str:
    """Return the one column of a joint, '' where its name is in none or in several."""
    found = columns_of_joints(names, [joint], prefixes)
    return found.get(joint, "")


def driving_input(log: Path) -> tuple[str, str] | None:
    """Return kind and column of an input that changes along a log; None if its name is unknown."""
    from sysid.logs.formats.registry import open_log

    try:
        table = open_log(log)
        for kind, prefixes in INPUTS.items():
            starts = tuple(plain(one) for one in prefixes)
            for name in table.names:
                if plain(name).startswith(starts):
                    values = table.read([name])[name]
                    if np.any(np.diff(values[np.isfinite(values)])):
                        return kind, name
    except SysidError:  # a film, or no table
        pass
    return None


def listed_names(log: Path) -> list[str]:
    """Return the names of numbered columns from LeRobot's `info.json`, beside a log or in `meta`; empty if it is missing."""
    for path in (
        log.parent / "info.json",
        log.parent / "meta" / "info.json",
        log.parent.parent / "meta" / "info.json",
    ):
        if path.is_file():
            try:
                content = json.loads(path.read_text(encoding="utf-8"))
            except (OSError, ValueError):
                return []
            features = content.get("features", content)
            for key in ("observation.state", "action", "joints", "names"):
                entry = features.get(key, []) if isinstance(features, dict) else []
                names = entry.get("names", []) if isinstance(entry, dict) else entry
                names = names.get("motors", []) if isinstance(names, dict) else names
                if names:
                    return [str(name).removesuffix(".pos") for name in names]
    return []


def require_columns(
    found: dict[str, str], joints: Sequence[str], what: str, names: Sequence[str], option: str
) -> dict[str, str]:
    """Return the columns, if there are any.

    Raises:
        SysidError: There are no columns.
    """
    if not found:
        raise SysidError(
            f"no column of {what} for each of the joints {', '.join(joints)}. Columns: {', '.join(names)}. "
            f"Give what their names begin with: {option} PREFIX; they are matched by the joints' names or in their order."
        )
    return found
