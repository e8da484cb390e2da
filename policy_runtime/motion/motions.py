"""Reference motions for the style reward: pelvis and joints at 50 frames a second.

A motion is an array of shape (frames, 36), the layout that the HUSKY release uses. Columns 0 to 2 are the pelvis position in
the world [m]. Columns 3 to 6 are its orientation, a unit quaternion wxyz. Columns 7 to 35 are the 29 joint angles [rad] in
the order of the full G1. Those are 12 of the legs, 3 of the waist and 7 of each arm. The six wrist joints (the last three of each arm) are
fixed here and skipped on reading. Our own clips hold zeros there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.options import STYLE_FRAMES, SkateOptions
from sim.skate.robot.g1 import MOTORS
from sim.skate.robot.poses import CLIP_JOINTS
from sysid.errors import SysidError, did_you_mean
from sysid.files import atomic_path, regular, shipped_data
from sysid.roll import Array

COLUMNS = 7 + len(MOTORS)
"""Of a stored motion: pose of the pelvis, and joints."""
PHASES = ("push", "mount", "dismount")
"""Phases that style can teach, in the order of `sim.skate.mdp.observations.phase_one_hot`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """One clip; a frame a policy step."""

    name: str
    position: Array
    """Pelvis position in the world [m], shape (frames, 3)."""
    quaternion: Array
    """Pelvis orientation wxyz, shape (frames, 4)."""
    joints: Array
    """Joint angles in policy order [rad], shape (frames, 23)."""

    @property
    def duration(self) -> float:
        """Time from the first to the last frame [s]."""
        return (len(self.joints) - 1) * CONTROL_PERIOD

    @property
    def speed(self) -> float:
        """Mean speed of the pelvis in the plane [m/s]."""
        return float(np.linalg.norm(self.position[-1, :2] - self.position[0, :2]) / self.duration)

    @property
    def qpos(self) -> Array:
        """The robot's MuJoCo configurations, shape (frames, 30)."""
        return np.hstack([self.position, self.quaternion, self.joints])

    def table(self) -> Array:
        """Return the clip in the stored layout, shape (frames, 36)."""
        table = np.zeros((len(self.joints), COLUMNS))
        table[:, :3], table[:, 3:7] = self.position, self.quaternion
        table[:, CLIP_JOINTS] = self.joints
        return table


def load_motion(path: Path) -> Motion:
    """Read a clip: a NumPy file holding (frames, 36) numbers, ours or the HUSKY release's."""
    try:
        table = np.load(regular(path), allow_pickle=False)
    except OSError as error:
        raise SysidError(
            f"{path}: cannot be read ({error.strerror or error}). Expected a .npy motion."
        ) from error
    except Exception as error:  # whatever a damaged header makes NumPy raise
        raise SysidError(f"{path}: not a NumPy array file (.npy) of numbers.") from error
    shape = getattr(table, "shape", "of an archive")
    if len(shape) != 2 or shape[1] != COLUMNS or table.dtype.kind != "f":
        raise SysidError(
            f"{path}: has shape {shape}; expected floats of shape (frames, {COLUMNS}): pelvis position 3, quaternion "
            "wxyz 4, and the 29 joints of the full G1."
        )
    if len(table) < STYLE_FRAMES:
        raise SysidError(
            f"{path}: has {len(table)} frames; one sample of the style reward takes {STYLE_FRAMES}."
        )
    length = np.linalg.norm(table[:, 3:7], axis=1)
    for row, column in np.argwhere(~np.isfinite(table))[:1]:
        raise SysidError(f"{path}: frame {row}, column {column} is {table[row, column]}; expected a number.")
    for row in np.flatnonzero(np.abs(length - 1) > 1e-2)[:1]:
        raise SysidError(
            f"{path}: the quaternion of frame {row} (columns 3 to 6) has length {length[row]:.3g}; expected 1. "
            "The columns may be in another order."
        )
    table = np.asarray(table, dtype=np.float64)
    return Motion(
        name=path.stem,
        position=table[:, :3],
        quaternion=table[:, 3:7] / length[:, None],
        joints=table[:, CLIP_JOINTS],
    )


def save_motion(motion: Motion, path: Path) -> None:
    """Write a clip in the stored layout."""
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.save(file, motion.table())


def motion_paths(where: Sequence[Path] = ()) -> list[Path]:
    """Return motion files: those named, those in folders named, shipped ones by their name, or all shipped clips."""
    shipped = sorted((shipped_data() / "motions").glob("*.npy"))
    by_name = {path.stem: path for path in shipped}
    paths: list[Path] = []
    for path in where:
        found = sorted(path.glob("*.npy")) if path.is_dir() else [path] if path.exists() else []
        if not found and str(path) in by_name:
            found = [by_name[str(path)]]
        if not found:
            raise SysidError(
                f"{path}: no motion (.npy) there.{did_you_mean(str(path), by_name)} Shipped clips: {', '.join(by_name)}."
            )
        paths += found
    return paths if where else shipped


def load_motions(where: Sequence[Path] = ()) -> list[Motion]:
    """Read clips from files and folders, or the shipped ones."""
    return [load_motion(path) for path in motion_paths(where)]


def windows(joints: Array) -> Array:
    """Return every run of `STYLE_FRAMES` successive frames of joint angles, (frames, 23), flat, oldest first [rad], (m, 5 · 23)."""
    if len(joints) < STYLE_FRAMES:
        return np.zeros((0, STYLE_FRAMES * joints.shape[1]))
    view = np.lib.stride_tricks.sliding_window_view(joints, STYLE_FRAMES, axis=0)
    return np.moveaxis(view, -1, 1).reshape(len(view), -1)


def transition_folder() -> Path:
    """Return where the shipped clips of mounting and dismounting are."""
    return shipped_data() / "motions" / "transitions"


def style_reference(options: SkateOptions, pushing: Sequence[Motion] = ()) -> Array:
    """Return the reference windows of the style discriminator in a variant of the task.

    If style also teaches mounting and dismounting, the last three numbers of a window name its phase one-hot.

    Args:
        options: The variant. Nothing taught by style still gets the pushing windows: the discriminator is
            built, and left alone.

    Returns:
        Windows [rad], shape (m, 5 · 23), or (m, 5 · 23 + 3) with phases, grouped by phase.
    """
    pushing = pushing or load_motions()
    if options.transition != "style":
        return np.concatenate([windows(motion.joints) for motion in pushing])
    clips = load_motions([transition_folder()])
    groups = {
        "push": pushing if options.pushing == "amp" else [],
        "mount": [clip for clip in clips if clip.name.startswith("mount")],
        "dismount": [clip for clip in clips if clip.name.startswith("dismount")],
    }
    rows = [
        np.hstack([found, np.tile(np.eye(len(PHASES))[i], (len(found), 1))])
        for i, name in enumerate(PHASES)
        for found in (windows(motion.joints) for motion in groups[name])
    ]
    return np.concatenate(rows)
