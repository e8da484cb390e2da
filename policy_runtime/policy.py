"""Policies as ONNX files: their observation, their answer, and what they were made for."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from policy_runtime.commands import Command
from policy_runtime.robots import RobotState
from sim.skate import rotation
from sim.skate.actor_observation import (
    FRAMES,
    OBSERVATION_SIZE,
    PARTS,
    History,
    projected_gravity,
    raw_frame,
    scale_frame,
    still_to_turn,
)
from sim.skate.clock import Clock
from sim.skate.g1 import JOINTS, default_pose, servos
from sysid.board import Board
from sysid.errors import HuskyError, QualityGateError
from sysid.roll import Array

RELEASE_SIZE = 395
"""Numbers that a policy of the HUSKY release takes: 79 a frame, grouped by term."""


class Policy(Protocol):
    """Turns state and command into joint targets, once a policy step."""

    name: str
    action: Array
    """The last answer in action units, shape (23,)."""

    def reset(self, state: RobotState) -> None:
        """Begin an episode in this state."""
        ...

    def act(self, state: RobotState, command: Command, step: int) -> Array:
        """Return joint targets [rad], shape (23,).

        Args:
            state: What the robot knows of itself.
            command: What the rider shall do.
            step: Policy steps since the cycle began.
        """
        ...


def action_for(target: Array) -> Array:
    """Return the action that asks for joint targets [rad]; both of shape (23,)."""
    return (target - default_pose()) / servos().action_scale


class PaperObservation:
    """The observation of the paper: the turn as it was told. See `sim.skate.actor_observation`."""

    size = OBSERVATION_SIZE

    def __init__(self) -> None:
        """Start without a history."""
        self._clock, self._default, self._history = Clock(), default_pose(), History()

    def reset(self) -> None:
        """Forget the frames seen."""
        self._history.reset()

    def build(self, state: RobotState, command: Command, last_action: Array, step: int) -> Array:
        """Return the observation of this step, shape (390,)."""
        return self._history.push(self.frame(state, command, last_action, step))

    def frame(self, state: RobotState, command: Command, last_action: Array, step: int) -> Array:
        """Return the newest frame, scaled, shape (78,)."""
        frame = raw_frame(
            np.array(command),
            state.angular_velocity,
            projected_gravity(state.quaternion),
            state.joint_position - self._default,
            state.joint_velocity,
            last_action,
            np.array([self._clock.phase(step)]),
        )
        return scale_frame(frame)


class FeedbackObservation(PaperObservation):
    """The observation that our policies are trained with: how far it still has to turn, by its own yaw."""

    def __init__(self) -> None:
        """Start without a history."""
        super().__init__()
        self._yaw_then: float | None = None

    def reset(self) -> None:
        """Forget the frames seen, and the yaw from which the turn counts."""
        super().reset()
        self._yaw_then = None

    def frame(self, state: RobotState, command: Command, last_action: Array, step: int) -> Array:
        """Return the newest frame, scaled, shape (78,)."""
        yaw = float(rotation.yaw(state.quaternion))
        clock = self._clock
        if self._yaw_then is None or step % clock.period == clock.push + clock.mount:
            self._yaw_then = yaw
        turn = float(still_to_turn(command.turn, yaw, self._yaw_then))
        return super().frame(state, Command(command.speed, turn), last_action, step)


class ReleaseObservation(PaperObservation):
    """The observation of the HUSKY release: a heading as third number, and the history grouped by term."""

    size = RELEASE_SIZE

    def __init__(self) -> None:
        """Start without a history."""
        super().__init__()
        sizes = [PARTS[0][1], 1, *(size for _, size, _, _ in PARTS[1:])]
        self._edges = np.cumsum([0, *sizes])
        self._frames: Array | None = None

    def reset(self) -> None:
        """Forget the frames seen."""
        self._frames = None

    def build(self, state: RobotState, command: Command, last_action: Array, step: int) -> Array:
        """Return the observation of this step, shape (395,)."""
        frame = self.frame(state, command, last_action, step)
        heading = rotation.yaw(state.quaternion) / np.pi
        frame = np.concatenate([frame[:2], [heading], frame[2:]])
        old = self._frames
        self._frames = np.tile(frame, (FRAMES, 1)) if old is None else np.vstack([old[1:], frame])
        parts = zip(self._edges[:-1], self._edges[1:], strict=True)
        return np.concatenate([self._frames[:, start:end].ravel() for start, end in parts])


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
    """What could not be checked, for people."""

    @property
    def turn_feedback(self) -> bool:
        """Whether it wants to see how far it still has to turn, instead of the turn as it was told."""
        return self.metadata.get("observation_turn") == "still-to-turn"


def open_policy(path: Path, board: Board | None = None, *, force: bool = False) -> PolicyFile:
    """Open an ONNX policy and check it against robot and board.

    Args:
        path: The file.
        board: The record of the board to ride; None leaves the board unchecked.
        force: Run even where board and policy disagree or the board has not passed `check`.

    Raises:
        HuskyError: onnxruntime is not installed, the file is not a policy of a known interface, or its
            metadata disagree with robot or board.
        QualityGateError: The policy was trained on a board that had passed, and this one has not.
    """
    session = _session(path)
    inputs, outputs = session.get_inputs(), session.get_outputs()
    size = _last_dimension(inputs[0].shape) if len(inputs) == 1 else None
    if size not in (OBSERVATION_SIZE, RELEASE_SIZE) or _last_dimension(outputs[0].shape) != len(JOINTS):
        shapes = ", ".join(f"{value.name} {value.shape}" for value in [*inputs, *outputs])
        raise HuskyError(
            f"{path}: not a skating policy. It has {shapes}; expected one input of {OBSERVATION_SIZE} (ours) or "
            f"{RELEASE_SIZE} numbers (the HUSKY release's) and an output of {len(JOINTS)}."
        )
    metadata = dict(session.get_modelmeta().custom_metadata_map)
    notes = check_robot(path, metadata)
    if board is not None:
        notes += check_board(path, metadata, board, force=force)
    return PolicyFile(path, session, inputs[0].name, outputs[0].name, size, metadata, notes)


def _session(path: Path) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise HuskyError(
            "running a policy needs onnxruntime, which is not installed. Run `pip install husky-sysid[run]`."
        ) from error
    if not path.is_file():
        raise HuskyError(f"{path}: no such policy. Expected an ONNX file, as `husky-sysid train` writes it.")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = (
        1  # waking threads takes longer than this net
    )
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise HuskyError(
            f"{path}: not an ONNX model that can be run ({str(error).splitlines()[0]})."
        ) from error


def _last_dimension(shape: list[Any]) -> int | None:
    return shape[-1] if len(shape) == 2 and isinstance(shape[-1], int) else None


def check_robot(path: Path, metadata: dict[str, str]) -> tuple[str, ...]:
    """Compare joint names, gains, default pose and action scales with the robot's; return what is unsaid.

    Raises:
        HuskyError: One of them differs.
    """
    names = metadata.get("joint_names")
    if names is None:
        raise HuskyError(f"{path}: carries no 'joint_names', so nothing says what its 23 answers move.")
    if tuple(names.split(",")) != JOINTS:
        other = next(
            (
                f"{i}: '{a}' instead of '{b}'"
                for i, (a, b) in enumerate(zip(names.split(","), JOINTS, strict=False))
                if a != b
            ),
            f"{len(names.split(','))} joints instead of {len(JOINTS)}",
        )
        raise HuskyError(f"{path}: made for another robot; joint {other}.")
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
            raise HuskyError(
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
        raise HuskyError(f"{path}: metadata '{key}' is {text[:60]!r}; expected {len(JOINTS)} numbers.")
    return numbers


def check_board(
    path: Path, metadata: dict[str, str], board: Board, *, force: bool = False
) -> tuple[str, ...]:
    """Compare the board that a policy was trained on with the one to ride; return notes for people.

    Raises:
        HuskyError: It is another board, or its record has changed since.
        QualityGateError: The board had passed `check` when the policy was trained, and has not now.
    """
    name = metadata.get("board")
    if name is None:
        return ("the policy does not say which board it was trained on; the board is not checked",)
    problem: HuskyError | None = None
    if name != board.name:
        problem = HuskyError(
            f"{path}: trained on board '{name}', not on '{board.name}'. Choose --board {name}."
        )
    else:
        for key, value in _board_numbers(board).items():
            stated = float(metadata.get(key, value))
            if abs(stated - value) > 0.01 * abs(value):
                problem = HuskyError(
                    f"{path}: trained with {key.replace('_', ' ')} {stated:.4g}, the record of '{name}' now says "
                    f"{value:.4g}. Train again, or use the record exported with the policy."
                )
                break
    if problem is None and metadata.get("board_passed") == "true" and not board.passed:
        problem = QualityGateError(
            f"board '{name}' had passed `check` when {path.name} was trained, and has not as it is recorded now. "
            f"Run `husky-sysid check` on it."
        )
    if problem is not None and not force:
        raise type(problem)(f"{problem} --force runs it all the same.")
    notes = () if problem is None else (f"forced: {problem}",)
    if metadata.get("board_passed") != "true":
        notes += (f"board '{name}' had not passed `check` when this policy was trained",)
    return notes


def _board_numbers(board: Board) -> dict[str, float]:
    return {
        "board_stiffness": board.stiffness,
        "board_damping": board.damping,
        "board_inertia": board.inertia.value,
    }


def _observation(file: PolicyFile) -> PaperObservation:
    if file.size == RELEASE_SIZE:
        return ReleaseObservation()
    return FeedbackObservation() if file.turn_feedback else PaperObservation()


class OnnxPolicy:
    """Runs an opened policy."""

    def __init__(self, file: PolicyFile) -> None:
        """Take the file; `reset` begins an episode."""
        self.name = file.path.stem
        self.file = file
        self._observation = _observation(file)
        self._default, self._scale = default_pose(), servos().action_scale
        self.action = np.zeros(len(JOINTS))

    def reset(self, state: RobotState) -> None:
        """Begin an episode; the first 'last action' is the one that asks for the present pose, as in training."""
        self._observation.reset()
        release = self.file.size == RELEASE_SIZE
        self.action = np.zeros(len(JOINTS)) if release else action_for(state.joint_position)

    def act(self, state: RobotState, command: Command, step: int) -> Array:
        """Return joint targets [rad], shape (23,)."""
        observation = self._observation.build(state, command, self.action, step).astype(np.float32)[None]
        answer = self.file.session.run([self.file.output_name], {self.file.input_name: observation})[0]
        self.action = np.asarray(answer, dtype=np.float64)[0]
        return self._default + self._scale * self.action
