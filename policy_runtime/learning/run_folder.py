"""Folder of a training run, with all data to understand and to resume it.

`config.toml`: Every option. `board.toml`: The record of the board. `motions/`: The run's own reference motions of pushing.
`origin.json`: Hashes of record and motions, versions, host, seed, GPUs, start, whether the board had passed.
`curves.jsonl`, `curves.png`: A line of numbers an iteration (`policy_runtime.learning.progress`).
`checkpoints/model_N.pt`: The learner after iteration N. `policy.onnx`: The last checkpoint's policy with its metadata.
"""

import contextlib
import dataclasses
import json
import os
import platform
import tomllib
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

import tomlkit

from policy_runtime.motion.motions import load_motions, motion_paths, save_motion, transition_folder
from sim.skate.options import SkateOptions
from sysid.board import load_board
from sysid.errors import SysidError, did_you_mean
from sysid.files import sha256, write_atomically, write_json

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnOptions:
    """Numbers of the learner (HUSKY, table of PPO)."""

    environments: int = 4096
    """Worlds a process."""
    steps: int = 24
    """Policy steps a world and iteration."""
    iterations: int = 3000
    seed: int = 1
    hidden: tuple[int, ...] = (512, 256, 128)
    """Widths of actor and critic."""
    initial_std: float = 0.5
    """Standard deviation of the first actions. The paper's 1.0 makes the penalties on action differences
    outweigh everything that can be earned, so that falling early pays."""
    restart_std: float = 0.0
    """Standard deviation of the actions with which a run from another's checkpoint begins; 0 for the checkpoint's."""
    epochs: int = 5
    mini_batches: int = 4
    clip: float = 0.2
    value_weight: float = 1.0
    entropy: float = 0.005
    """Weight of the actions' entropy; where the curriculum leads, a beginner's."""
    last_entropy: float = 0.001
    """Weight of the actions' entropy at the end of the curriculum."""
    curriculum: bool = True
    """Whether the task becomes harder as the learner does better; see `policy_runtime.learning.curriculum`."""
    learning_rate: float = 1e-3
    """First learning rate of a new run; it adapts."""
    desired_kl: float = 0.015
    gamma: float = 0.99
    lam: float = 0.95
    """λ of generalised advantage estimation."""
    gradient_norm: float = 1.0
    save_every: int = 100
    """Iterations between checkpoints."""
    style_weight: float = 25.0
    """Weight of the style reward per second."""


SIGNED = ("pose_offset",)
"""Options that may be negative."""
POSITIVE = ("mount_steps", "bezier_order", "speed_tolerance", "learning_rate", "desired_kl", "save_every")
"""Options that must be larger than 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunConfig:
    """All options of a run."""

    task: SkateOptions = field(default_factory=SkateOptions)
    learn: LearnOptions = field(default_factory=LearnOptions)

    def changed(self, text: str) -> "RunConfig":
        """Return the options with one changed, by 'NAME=VALUE' with a value as in config.toml; words need no quotes.

        Raises:
            SysidError: There is no such option, or the value is of another kind or negative.
        """
        name, equals, word = text.partition("=")
        parts = {"task": self.task, "learn": self.learn}
        hints = {part: typing.get_type_hints(type(options)) for part, options in parts.items()}
        part = next((part for part in parts if name in hints[part]), None)
        if part is None or not equals:
            known = [known for names in hints.values() for known in names]
            raise SysidError(
                f"--set {text}: expected NAME=VALUE with an option of config.toml.{did_you_mean(name, known)}"
            )
        try:
            value = tomllib.loads(f"value = {word}")["value"]
        except tomllib.TOMLDecodeError:
            value = word
        if isinstance(value, int | float):
            if value < 0 and name not in SIGNED:
                raise SysidError(f"--set {text}: must not be negative.")
            if value == 0 and name in POSITIVE:
                raise SysidError(f"--set {text}: must be larger than 0.")
        changes: dict[str, Any] = {name: _value(hints[part][name], value, f"--set {name}")}
        changes = {part: dataclasses.replace(parts[part], **changes)}
        return dataclasses.replace(self, **changes)


class RunFolder:
    """The files of the module's table."""

    def __init__(self, path: Path) -> None:
        """Name the files."""
        self.path = path
        self.config, self.board = path / "config.toml", path / "board.toml"
        self.origin = path / "origin.json"
        self.curves, self.policy = path / "curves.jsonl", path / "policy.onnx"

    def motions(self) -> list[Path]:
        """Return the reference motions of pushing: the run's own, or the shipped ones."""
        own = self.path / "motions"
        return motion_paths([own] if own.is_dir() else [])

    def checkpoint(self, iteration: int) -> Path:
        """Return the path of the checkpoint after an iteration."""
        return self.path / "checkpoints" / f"model_{iteration}.pt"

    def checkpoints(self) -> list[Path]:
        """Return all checkpoints, oldest first."""
        return sorted((self.path / "checkpoints").glob("model_*.pt"), key=_iteration)

    def done(self) -> int:
        """Return the iterations of the newest checkpoint; 0 without one."""
        return max((_iteration(path) for path in self.checkpoints()), default=0)

    def write_config(self, config: RunConfig) -> None:
        """Write the options."""
        write_atomically(self.config, tomlkit.dumps(_plain(dataclasses.asdict(config))))

    def begin(
        self,
        config: RunConfig,
        record: Path,
        start_from: Path | None = None,
        *,
        gpus: int = 1,
        motions: Sequence[Path] = (),
    ) -> None:
        """Write the data of a run before it starts: options, record and their origin.

        Args:
            record: The board's record file; it is copied.
            start_from: A checkpoint of another run to begin with; it is copied.
            gpus: GPUs of the run, 0 for the CPU.
            motions: Files and folders of reference motions of pushing; they are copied. The shipped ones if none.
        """
        clips = load_motions(motions) if motions else []
        if start_from is not None:
            if not start_from.is_file() or not start_from.stem.removeprefix("model_").isdigit():
                raise SysidError(f"{start_from}: no checkpoint; expected a file model_N.pt of another run.")
            write_atomically(self.checkpoint(_iteration(start_from)), start_from.read_bytes())
        self.write_config(config)
        write_atomically(self.board, record.read_bytes())
        for clip in clips:
            (self.path / "motions").mkdir(exist_ok=True)
            save_motion(clip, self.path / "motions" / f"{clip.name}.npy")
        origin = {
            "board_sha256": sha256(record),
            "board_passed": load_board(record).passed,
            "motions_sha256": {
                path.name: sha256(path) for path in [*self.motions(), *motion_paths([transition_folder()])]
            },
            "start_from": None
            if start_from is None
            else {"path": str(start_from), "sha256": sha256(start_from)},
            "seed": config.learn.seed,
            "gpus": gpus,
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
            "platform": platform.platform(),
            "versions": _versions(),
        }
        write_json(self.origin, origin)

    def read_config(self) -> RunConfig:
        """Read the options back."""
        try:
            raw = tomllib.loads(self.config.read_text(encoding="utf-8"))
        except OSError as error:
            raise SysidError(f"{self.config}: no training run there ({error.strerror}).") from error
        except tomllib.TOMLDecodeError as error:
            raise SysidError(f"{self.config}: not a TOML file ({error}).") from error
        return _build(RunConfig, raw, str(self.config))

    def started_from(self) -> Path | None:
        """Return where `begin` put the checkpoint of another run, or None."""
        start = self._read_origin().get("start_from")
        return None if start is None else self.checkpoint(_iteration(Path(start["path"])))

    def gpus(self) -> int:
        """Return the number of GPUs of the run's start; 1 if unknown."""
        return int(self._read_origin().get("gpus", 1))

    def _read_origin(self) -> dict[str, Any]:
        return json.loads(self.origin.read_text(encoding="utf-8")) if self.origin.exists() else {}

    def has_learned(self) -> bool:
        """Whether the run has a result: an iteration, or a checkpoint of its own."""
        return bool(self.read_curves()) or any(path != self.started_from() for path in self.checkpoints())

    def discard(self) -> None:
        """Remove the files of `begin`, and the folder if it is empty then."""
        written = (self.config, self.board, self.origin, self.curves)
        for path in (*written, *self.checkpoints(), *self.path.glob("motions/*.npy")):
            path.unlink(missing_ok=True)
        for folder in (self.path / "checkpoints", self.path / "motions", self.path):
            with contextlib.suppress(OSError):
                folder.rmdir()

    def add_to_curves(self, numbers: Mapping[str, float]) -> None:
        """Add an iteration's report; an incomplete one from a killed run stays on its own line."""
        with self.curves.open("ab+") as file:
            if file.tell() > 0:
                file.seek(-1, os.SEEK_END)
                if file.read() != b"\n":
                    file.write(b"\n")
            file.write((json.dumps(numbers) + "\n").encode())

    def read_curves(self) -> list[dict[str, float]]:
        """Return the iterations' reports in order.

        A line cut short by a kill is left out, and so are iterations that were lost by it and done again.
        """
        lines = self.curves.read_text(encoding="utf-8").splitlines() if self.curves.exists() else []
        rows: list[dict[str, float]] = []
        for line in lines:
            try:
                row = json.loads(line)
            except json.JSONDecodeError:
                continue
            while rows and rows[-1]["iteration"] >= row["iteration"]:
                rows.pop()
            rows.append(row)
        return rows


def next_run(outputs: Path) -> Path:
    """Return the folder of a new run below a board's outputs, numbered after the newest."""
    numbers = [int(path.name.removeprefix("train-")) for path in outputs.glob("train-*") if path.is_dir()]
    return outputs / f"train-{max(numbers, default=0) + 1}"


PACKAGES = (
    *("husky-sysid", "mjlab", "mujoco", "mujoco-warp", "warp-lang"),
    *("rsl-rl-lib", "torch", "numpy"),
)
"""Their versions decide a run's outcome."""


def _versions() -> dict[str, str]:
    """Return the versions of `PACKAGES`; absent ones are left out."""
    found: dict[str, str] = {}
    for name in PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def _iteration(path: Path) -> int:
    return int(path.stem.removeprefix("model_"))


def _plain(value: Any) -> Any:
    """Return nested dictionaries with lists for tuples, as TOML has them."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return list(value) if isinstance(value, tuple) else value


def _build(kind: type[T], raw: Any, where: str) -> T:
    """Return a dataclass from nested dictionaries, checking names and kinds."""
    if not isinstance(raw, Mapping):
        raise SysidError(f"{where}: is {raw!r}; expected a table.")
    hints = typing.get_type_hints(kind)
    for name in raw:
        if name not in hints:
            raise SysidError(f"{where}: unknown option '{name}'.{did_you_mean(name, hints)}")
    return kind(**{name: _value(hints[name], value, f"{where}: {name}") for name, value in raw.items()})


def _value(hint: Any, value: Any, where: str) -> Any:
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return _build(hint, value, where)
    kind, arguments = typing.cast("Any", hint), typing.get_args(hint)
    if typing.get_origin(hint) is typing.Literal:
        if value not in arguments:
            raise SysidError(f"{where} is {value!r}; expected one of {', '.join(map(str, arguments))}.")
        return value
    if arguments and isinstance(value, list):
        return tuple(_value(arguments[0], item, where) for item in value)
    if hint is float and type(value) is int:
        return float(value)
    if arguments or not isinstance(value, kind):
        raise SysidError(f"{where} is {value!r}; expected {getattr(hint, '__name__', hint)}.")
    return value
