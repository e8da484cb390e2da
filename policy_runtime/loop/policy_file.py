"""ONNX files of policies: opened, and checked against the robot and the board that they were made for."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from policy_runtime.loop.observing import RELEASE_SIZE
from policy_runtime.loop.policy_trial import open_session, require_answer, session_options
from sim.skate.mdp.actor_observation import OBSERVATION_SIZE
from sim.skate.robot.g1 import JOINTS, default_pose, servos
from sim.skate.world.posterior import Spread
from sysid.board import Board
from sysid.errors import QualityGateError, SysidError
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
    options = session_options()
    if not path.is_file():
        raise SysidError(f"{path}: no such policy. Expected an ONNX file, as `husky-sysid train` writes it.")
    require_answer(path)
    return open_session(path, options)


def _last_dimension(shape: list[Any]) -> int | None:
    return shape[-1] if len(shape) == 2 and isinstance(shape[-1], int) else None


def check_robot(path: Path, metadata: dict[str, str]) -> tuple[str, ...]:
    """Compare joint names, gains, default pose and action scales with the robot's; return notes.

    Raises:
        SysidError: One of them differs.
    """
    names = metadata.get("joint_names")
    if names is None:
        raise SysidError(f"{path}: carries no 'joint_names', so nothing says what its 23 answers move.")
    if tuple(names.split(",")) != JOINTS:
        other = next(
            (
                f"{i}: '{a}' instead of '{b}'"
                for i, (a, b) in enumerate(zip(names.split(","), JOINTS, strict=False))
                if a != b
            ),
            f"{len(names.split(','))} joints instead of {len(JOINTS)}",
        )
        raise SysidError(f"{path}: made for another robot; joint {other}.")
    robot = servos()
    expected = {
        ("joint_stiffness", "stiffness"): robot.stiffness,
        ("joint_damping", "damping"): robot.damping,
        ("default_joint_pos",): default_pose(),
        ("action_scale",): robot.action_scale,
    }
    notes: list[str] = []
    for keys, values in expected.items():
        text = next((metadata[key] for key in keys if key in metadata), None)
        if text is None:
            notes.append(f"the policy does not say its {keys[0].replace('_', ' ')}; the robot's is used")
            continue
        stated = _numbers(path, keys[0], text)
        # Metadata are printed to three decimals.
        bad = np.flatnonzero(np.abs(stated - values) > 1e-3 + 2e-3 * np.abs(values))
        if len(bad):
            i = int(bad[0])
            raise SysidError(
                f"{path}: its {keys[0].replace('_', ' ')} of {JOINTS[i]} is {stated[i]:g}, the robot's is "
                f"{values[i]:.4g}. It was trained for other servos."
            )
    return tuple(notes)


def _numbers(path: Path, key: str, text: str) -> Array:
    try:
        numbers = np.array([float(part) for part in text.split(",")])
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape == (1,):
        numbers = np.full(len(JOINTS), numbers[0])
    if numbers.shape != (len(JOINTS),):
        raise SysidError(f"{path}: metadata '{key}' is {text[:60]!r}; expected {len(JOINTS)} numbers.")
    return numbers


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
    notes: tuple[str, ...] = ()
    problem: SysidError | None = None
    if name != board.name:
        problem = SysidError(
            f"{path}: trained on board '{name}', not on '{board.name}'. Choose --board {name}."
        )
    else:
        for key, (value, spread) in _board_numbers(board).items():
            stated = _stated(path, metadata, key, value)
            change = f"trained with {key.replace('_', ' ')} {stated:.4g}, the record of '{name}' now says {value:.4g}"
            if abs(stated - value) > spread * abs(value):
                problem = SysidError(
                    f"{path}: {change}. Train again, or use the record exported with the policy."
                )
                break
            if abs(stated - value) > 0.01 * abs(value):
                notes += (f"{change}: within what training spreads its boards over",)
    if problem is None and metadata.get("board_passed") == "true" and not board.passed:
        problem = QualityGateError(
            f"board '{name}' had passed `check` when {path.name} was trained, and has not as it is recorded now. "
            f"Run `husky-sysid check` on it."
        )
    if problem is not None:
        if not force:
            raise type(problem)(f"{problem} --force runs it all the same.")
        notes += (f"forced: {problem}",)
    if metadata.get("board_passed") != "true":
        since = "; it has now" if board.passed else ""
        notes += (f"board '{name}' had not passed `check` when this policy was trained{since}",)
    return notes


def _stated(path: Path, metadata: dict[str, str], key: str, default: float) -> float:
    try:
        return float(metadata.get(key, default))
    except ValueError:
        raise SysidError(f"{path}: metadata '{key}' is {metadata[key][:60]!r}; expected a number.") from None


def _board_numbers(board: Board) -> dict[str, tuple[float, float]]:
    """Return a policy's numbers of its board, and by how much a record may have changed since, relative.

    Training draws its boards at least that far apart (`sim.skate.world.posterior.Spread`), so a refit by less is
    a board that the policy has ridden.
    """
    spread = Spread()
    return {
        "board_stiffness": (board.stiffness, spread.relative),
        "board_damping": (board.damping, spread.relative),
        "board_inertia": (board.inertia.value, spread.inertia),
    }
