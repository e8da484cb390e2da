"""ONNX files of policies: opened, and checked against the robot and the board that they were made for."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from policy_runtime.loop.observing import RELEASE_SIZE
from sim.skate.mdp.actor_observation import OBSERVATION_SIZE
from sim.skate.robot.g1 import JOINTS, default_pose, servos
from sim.skate.world.posterior import Spread
from sysid.board import Board
from sysid.errors import QualityGateError, SysidError, needs_extra
from sysid.files import shipped_data
from sysid.roll import Array


@dataclass(frozen=True, slots=True)
class PolicyFile:
    """An ONNX policy that has been opened and found to fit the robot."""

    path: Path
    session: Any
    """onnxruntime.InferenceSession."""
    input_name: str
    output_name: str
    size: int
    """Numbers of one observation."""
    metadata: dict[str, str]
    notes: tuple[str, ...]
    """Properties that could not be checked, for people."""

    @property
    def turn_feedback(self) -> bool:
        """Whether it sees the remaining turn, instead of the commanded turn."""
        return self.metadata.get("observation_turn") == "still-to-turn"


def open_policy(path: Path, board: Board | None = None, *, force: bool = False) -> PolicyFile:
    """Open an ONNX policy and check it against robot and board.

    Args:
        board: The record of the board to ride; None leaves the board unchecked.
        force: Run even where board and policy disagree or the board has not passed `check`.

    Raises:
        SysidError: onnxruntime is not installed, the file is not a policy of a known interface, or its
            metadata disagree with robot or board.
        QualityGateError: The policy was trained on a board that had passed, and this one has not.
    """
    session = _session(path)
    inputs, outputs = session.get_inputs(), session.get_outputs()
    size = _last_dimension(inputs[0].shape) if len(inputs) == 1 else None
    if size not in (OBSERVATION_SIZE, RELEASE_SIZE) or _last_dimension(outputs[0].shape) != len(JOINTS):
        shapes = ", ".join(f"{value.name} {value.shape}" for value in [*inputs, *outputs])
        raise SysidError(
            f"{path}: not a skating policy. It has {shapes}; expected one input of {OBSERVATION_SIZE} (ours) or "
            f"{RELEASE_SIZE} numbers (the HUSKY release's) and an output of {len(JOINTS)}."
        )
    metadata = dict(session.get_modelmeta().custom_metadata_map)
    notes = check_robot(path, metadata)
    if board is not None:
        notes += check_board(path, metadata, board, force=force)
    return PolicyFile(path, session, inputs[0].name, outputs[0].name, size, metadata, notes)


def find_policy(name: str) -> Path | None:
    """Return the file of a policy: the path itself, or one that ships with the tool, by its name; None if neither is there."""
    shipped = shipped_data() / "policies" / f"{Path(name).name.removesuffix('.onnx')}.onnx"
    for path in (Path(name), *([shipped] if Path(name).name == name else [])):
        if path.is_file():
            return path
    return None


def _session(path: Path) -> Any:
    """Return onnxruntime's session of a file, on one thread: waking others takes longer than such a network."""
    if not path.is_file():
        raise SysidError(f"{path}: no such policy. Expected an ONNX file, as `husky-sysid train` writes it.")
    # Else importing it writes into the home folder and sends data.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    with needs_extra("run", "running a policy"):
        import onnxruntime
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises its own kinds, one a status
        raise SysidError(
            f"{path}: not an ONNX model that can be run ({str(error).splitlines()[0]})."
        ) from error


def _last_dimension(shape: list[Any]) -> int | None:
    return shape[-1] if len(shape) == 2 and isinstance(shape[-1], int) else None


def check_robot(path: Path, metadata: dict[str, str]) -> tuple[str, ...]:
    """Compare joint names, gains, default pose and action scales with the robot's; return notes."""
    names = tuple(metadata.get("joint_names", "").split(","))
    if names != JOINTS:
        raise SysidError(
            f"{path}: made for another robot, or for joints in another order: {', '.join(names)}."
        )
    robot = servos()
    expected = {
        "joint_stiffness": robot.stiffness,
        "joint_damping": robot.damping,
        "default_joint_pos": default_pose(),
        "action_scale": robot.action_scale,
    }
    notes: list[str] = []
    for key, values in expected.items():
        said = key.replace("_", " ")
        if key not in metadata:
            notes.append(f"the policy does not say its {said}; the robot's is used")
            continue
        stated = _numbers(path, key, metadata[key])
        # Metadata are printed to three decimals.
        bad = np.flatnonzero(np.abs(stated - values) > 1e-3 + 2e-3 * np.abs(values))
        if len(bad):
            i = int(bad[0])
            raise SysidError(
                f"{path}: its {said} of {JOINTS[i]} is {stated[i]:g}, the robot's is {values[i]:.4g}. It was trained for "
                "other servos."
            )
    return tuple(notes)


def _numbers(path: Path, key: str, text: str) -> Array:
    try:
        return np.broadcast_to(np.array([float(part) for part in text.split(",")]), len(JOINTS))
    except ValueError:
        raise SysidError(
            f"{path}: metadata '{key}' is {text[:60]!r}; expected {len(JOINTS)} numbers."
        ) from None


def check_board(
    path: Path, metadata: dict[str, str], board: Board, *, force: bool = False
) -> tuple[str, ...]:
    """Compare the board that a policy was trained on with the one to ride; return notes for people.

    Raises:
        SysidError: It is another board, or its record has changed since.
        QualityGateError: The board had passed `check` when the policy was trained, and has not now.
    """
    name = metadata.get("board")
    if name is None:
        return ("the policy does not say which board it was trained on; the board is not checked",)
    notes: list[str] = []
    passed = metadata.get("board_passed") == "true"
    try:
        _require_board(path, metadata, board, notes)
        if passed and not board.passed:
            raise QualityGateError(
                f"board '{name}' had passed `check` when {path.name} was trained, and has not as it is recorded now. "
                f"Run `husky-sysid check` on it."
            )
    except SysidError as problem:
        if not force:
            raise type(problem)(f"{problem} --force runs it all the same.") from None
        notes.append(f"forced: {problem}")
    if not passed:
        since = "; it has now" if board.passed else ""
        notes.append(f"board '{name}' had not passed `check` when this policy was trained{since}")
    return tuple(notes)


def _require_board(path: Path, metadata: dict[str, str], board: Board, notes: list[str]) -> None:
    """Refuse another board than the policy's; note a refit within the spread of training.

    Training draws its boards at least that far apart (`sim.skate.world.posterior.Spread`), so a refit by less is
    a board that the policy has ridden.
    """
    name, spread = metadata["board"], Spread()
    if name != board.name:
        raise SysidError(f"{path}: trained on board '{name}', not on '{board.name}'. Choose --board {name}.")
    for key, value, most in (
        ("board_stiffness", board.stiffness, spread.relative),
        ("board_damping", board.damping, spread.relative),
        ("board_inertia", board.inertia.value, spread.inertia),
    ):
        try:
            stated = float(metadata.get(key, value))
        except ValueError:
            raise SysidError(
                f"{path}: metadata '{key}' is {metadata[key][:60]!r}; expected a number."
            ) from None
        change = (
            f"trained with {key.replace('_', ' ')} {stated:.4g}, the record of '{name}' now says {value:.4g}"
        )
        if abs(stated - value) > most * abs(value):
            raise SysidError(f"{path}: {change}. Train again, or use the record exported with the policy.")
        if abs(stated - value) > 0.01 * abs(value):
            notes.append(f"{change}: within the spread of the boards in training")
