# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""One folder that runs by itself: scene with meshes, policy, board record; neither mjlab nor torch needed.

`scene.xml` and `assets/` hold robot, board and ground, `BOARD.toml` the board's record, `policy.onnx` the policy, if given.
`folder.json` has names, SHA-256, versions and the start configuration.
"""

import json
import re
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import mujoco
import numpy as np

from policy_runtime.loop.policy_file import open_policy
from policy_runtime.loop.world import World, world_of
from policy_runtime.robots import PD_PERIOD
from policy_runtime.robots.simulated import Gantry
from sim.board.scene import Coupling
from sim.skate.robot.g1 import g1_xml
from sim.skate.world.scene import SceneOptions, skate_spec, standing_state
from sim.skate.world.terrain import Terrain
from sysid.board import Board, load_board, save_board
from sysid.errors import SysidError
from sysid.files import sha256, write_atomically, write_json
from sysid.roll import Array

MANIFEST = "folder.json"
FORMAT = 1


@dataclass(frozen=True, slots=True)
class Bundle:
    """An exported folder that has been read and found whole."""

    board: Board
    policy: Path | None
    model: mujoco.MjModel
    start: Array
    """Configuration at the start, shape (nq,)."""
    direct_rake: float | None

    def world(self, *, start: str = "stand", gantry: Gantry | None = None) -> World:
        """Return the world of this folder; `start` as in `world.make_world`."""
        return world_of(
            self.model, start=start, direct_rake=self.direct_rake, gantry=gantry, standing=self.start
        )


def export_folder(
    board: Board,
    folder: Path,
    *,
    policy: Path | None = None,
    coupling: Coupling = "equality",
    terrain: Terrain = "flat",
    force: bool = False,
) -> list[Path]:
    """Write the folder and return its files.

    Args:
        folder: Folder to write; an existing one is replaced only if it is an exported folder.
    """
    if policy is not None:
        open_policy(policy, board, force=force)
    try:
        _replace(folder, lambda made: _write(board, made, policy, coupling, terrain))
    except OSError as error:
        raise SysidError(
            f"{folder}: cannot write there ({error.strerror or error}). Choose a folder you may write to with --output."
        ) from error
    return sorted(path for path in folder.rglob("*") if path.is_file())


def _replace(folder: Path, write: Callable[[Path], None]) -> None:
    """Let a folder be written beside the one that it then replaces."""
    if folder.exists() and any(folder.iterdir()) and not (folder / MANIFEST).is_file():
        raise SysidError(f"{folder}: not empty, and not an exported folder. Choose another with --output.")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as name:
        made = Path(name) / folder.name
        made.mkdir()
        write(made)
        if folder.exists():
            shutil.rmtree(folder)
        made.replace(folder)


def _write(board: Board, folder: Path, policy: Path | None, coupling: Coupling, terrain: Terrain) -> None:
    spec = skate_spec(
        board, SceneOptions(coupling=coupling, terrain=terrain, timestep=PD_PERIOD), visuals=True
    )
    model = spec.compile()
    spec.meshdir = "assets"
    text = spec.to_xml()
    write_atomically(folder / "scene.xml", text)
    (folder / "assets").mkdir()
    for mesh in sorted(set(re.findall(r'file="([^"]+)"', text))):
        shutil.copyfile(g1_xml().parent / "assets" / Path(mesh).name, folder / "assets" / Path(mesh).name)
    save_board(board, folder / f"{board.name}.toml")
    if policy is not None:
        shutil.copyfile(policy, folder / "policy.onnx")
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    manifest = {
        "format": FORMAT,
        "board": board.name,
        "board_passed": board.passed,
        "policy": None if policy is None else "policy.onnx",
        "coupling": coupling,
        "rake": board.geometry["rake"].value,
        "start": standing_state(model).tolist(),
        "versions": {"husky-sysid": version("husky-sysid"), "mujoco": mujoco.__version__},
        "sha256": {path.relative_to(folder).as_posix(): sha256(path) for path in files},
    }
    write_json(folder / MANIFEST, manifest)


def load_folder(folder: Path) -> Bundle:
    """Read an exported folder, checking every file against its SHA-256."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        if manifest["format"] != FORMAT:
            raise ValueError(f"format {manifest['format']}")
        digests: dict[str, str] = manifest["sha256"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SysidError(
            f"{folder}: not a folder that this version exports ({MANIFEST}: {error}). Export it again."
        ) from error
    for name, digest in digests.items():
        if not (folder / name).is_file() or sha256(folder / name) != digest:
            raise SysidError(f"{folder / name}: missing, or changed since it was exported. Export it again.")
    try:
        model = mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))
    except ValueError as error:
        written = manifest["versions"].get("mujoco")
        raise SysidError(
            f"{folder / 'scene.xml'}: MuJoCo {mujoco.__version__} cannot read it ({error}); it was written by {written}."
        ) from error
    return Bundle(
        board=load_board(folder / f"{manifest['board']}.toml"),
        policy=None if manifest["policy"] is None else folder / manifest["policy"],
        model=model,
        start=np.array(manifest["start"]),
        direct_rake=float(manifest["rake"]) if manifest["coupling"] == "direct" else None,
    )
