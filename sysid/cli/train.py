"""`husky-sysid train`: a policy for a board."""

import math
import subprocess
import sys
from dataclasses import dataclass, fields, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from policy_runtime.learning.run_folder import LearnOptions, RunConfig, RunFolder, next_run
from sim.skate.cycle.start import AT_REST, Start
from sim.skate.options import SkateOptions
from sysid.board import Board, load_board
from sysid.cli.console import Common, Printer
from sysid.errors import QualityGateError, SysidError, install_extra


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Variant:
    """Options of the task: the paper's variants, and ours."""

    pushing: Literal["amp", "tracking", "gait", "none"] = "amp"
    """Guidance of pushing: the style of reference motions, tracking of the one nearest in speed, a clock of foot
    contacts, or none."""
    transition: Literal["path", "translation", "style", "none"] = "path"
    """Guidance of mounting and dismounting: paths of key bodies, their positions only, the style of reference
    motions, or none."""
    tilt_guidance: bool = True
    """Whether the tilt is guided."""
    turn_feedback: bool = True
    """Whether the actor sees the remaining turn; else it sees the commanded turn, as in the paper."""
    kinematics: Literal["two-truck", "single-truck"] = "two-truck"
    """Turning of the board; single-truck is the paper's formula."""
    coupling: Literal["equality", "direct", "none"] = "equality"
    """Steering of the trucks by tilt; with 'none' the board goes straight."""
    start: Literal["mixed", "standing"] = "mixed"
    """Start of the episodes: half at rest and the others anywhere in the cycle, or all at rest as in the paper."""
    terrain: Literal["flat", "slopes", "steps"] = "flat"
    """The ground."""
    pushes: Annotated[float, Parameter(validator=Number(gte=0))] = 0.5
    """Largest change of velocity by external pushes [m/s]."""
    pose_offset: float = 0.0
    """Perturbation of the canonical poses: added to every joint [rad]."""
    mount_steps: Annotated[int, Parameter(validator=Number(gte=1))] = 30
    """Length of mounting in policy steps of 20 ms."""
    bezier_order: Annotated[int, Parameter(validator=Number(gte=1))] = 2
    """Order of the transition's path."""
    lift: float = 0.2
    """Lift of the path's inner control points [m]."""
    stance_patience: Annotated[int, Parameter(validator=Number(gte=0))] = 20
    """Policy steps with the left foot in the wrong place that end an episode; 0 for never."""
    idle_patience: Annotated[float, Parameter(validator=Number(gte=0))] = 1.2
    """Time of pushing without the left foot on the ground that ends an episode [s]; 0 for never."""
    smoothness: Annotated[float, Parameter(validator=Number(gte=0))] = 0.05
    """Weight of the squared first and second differences of the actions."""
    speed_tolerance: Annotated[float, Parameter(validator=Number(gt=0))] = 0.25
    """Tolerance of the reward for the speed while pushing [m^2/s^2]."""

    def options(self) -> SkateOptions:
        """Return the task's options."""
        ours: dict[str, Any] = {
            "coupling": "equality" if self.coupling == "none" else self.coupling,
            "steered": self.coupling != "none",
            "start": Start() if self.start == "mixed" else AT_REST,
        }
        return SkateOptions(**(vars(self) | ours))


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Learner:
    """Options of the learner."""

    environments: Annotated[int, Parameter(validator=Number(gte=1))] = 4096
    """Worlds on each GPU."""
    iterations: Annotated[int | None, Parameter(validator=Number(gte=1))] = None
    """Iterations in all: 3000 for a new run, and with --from as many beyond that checkpoint; with --resume the new total."""
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = 1
    """Seed of everything random."""
    learning_rate: Annotated[float, Parameter(validator=Number(gt=0))] = 1e-3
    """Initial value of the adaptive learning rate of a new run."""
    entropy: Annotated[float, Parameter(validator=Number(gte=0))] = 0.005
    """Weight of the actions' entropy."""
    last_entropy: Annotated[float, Parameter(validator=Number(gte=0))] = 0.001
    """Weight of the actions' entropy at the end of the curriculum."""
    desired_kl: Annotated[float, Parameter(validator=Number(gt=0))] = 0.015
    """Target change of the policy per iteration, for the learning rate."""
    restart_std: Annotated[float, Parameter(validator=Number(gte=0))] = 0.0
    """Initial standard deviation of the actions of a run by --from; 0 for that of the checkpoint. A larger one unlearns habits."""
    save_every: Annotated[int, Parameter(validator=Number(gte=1))] = 100
    """Iterations between checkpoints."""
    style_weight: Annotated[float, Parameter(validator=Number(gte=0))] = 25.0
    """Weight of the style reward per second."""
    curriculum: Literal["on", "off"] = "on"
    """Whether the task becomes harder as the learner improves: patience with a wrong stance, entropy, differences of the
    worlds. Off: the full task from the first iteration."""
    graphs: bool = True
    """Whether to launch many small operations as one CUDA graph."""

    def options(self, done: int = 0) -> LearnOptions:
        """Return the learner's options, for a run that begins after so many iterations."""
        iterations = done + LearnOptions().iterations if self.iterations is None else self.iterations
        if iterations <= done:
            raise SysidError(
                f"--iterations {iterations}: that checkpoint has done {done} already, and this is the number in all."
            )
        ours: dict[str, Any] = {"iterations": iterations, "curriculum": self.curriculum == "on"}
        return LearnOptions(**(vars(self) | ours))


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Machines:
    """A run on several machines: the same command on each, with a shared folder."""

    nodes: Annotated[int, Parameter(validator=Number(gte=1))] = 1
    """Number of machines; each brings --gpus."""
    node: Annotated[int, Parameter(validator=Number(gte=0))] = 0
    """Number of this machine; 0 begins the run."""
    rendezvous: str | None = None
    """Address of machine 0, HOST:PORT."""

    def torchrun(self, gpus: int) -> list[str]:
        """Return torchrun's options for so many GPUs on each machine.

        Raises:
            SysidError: The machines do not fit together.
        """
        processes = f"--nproc-per-node={max(1, gpus)}"
        if self.nodes == 1 and self.node == 0 and self.rendezvous is None:
            return ["--standalone", processes]
        host, _, port = (self.rendezvous or "").rpartition(":")
        if self.node >= self.nodes or not host or not port.isdigit():
            raise SysidError(
                f"--nodes {self.nodes} --node {self.node} --rendezvous {self.rendezvous}: expected machines 0 to "
                f"{self.nodes - 1} and the address of machine 0, HOST:PORT."
            )
        here = [f"--nnodes={self.nodes}", f"--node-rank={self.node}"]
        return [*here, f"--master-addr={host}", f"--master-port={port}", processes]


def train(
    *,
    board: str,
    variant: Variant = Variant(),
    learner: Learner = Learner(),
    gpus: Literal[0, 1, 2, 4, 8] | None = None,
    machines: Machines = Machines(),
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    resume: Path | None = None,
    start_from: Annotated[Path | None, Parameter(name="--from")] = None,
    motions: Path | None = None,
    minutes: Annotated[float, Parameter(validator=Number(gt=0))] = math.inf,
    force: bool = False,
    common: Common = Common(),
) -> int:
    """Train a policy for a board.

    One folder gets the resolved options, the record, hashes and versions, curves, checkpoints and the policy as ONNX.
    Continue a killed run with --resume.

    Args:
        board: Name of the board.
        variant: Options of the task.
        learner: Options of the learner.
        gpus: Number of GPUs, one process each; 0 trains on the CPU, for a trial. Default: 1, and with --resume that of the
            run.
        machines: Other machines of the run.
        output: Folder of the run; the default is reports/BOARD/train-N.
        resume: Folder of a run to continue from its newest checkpoint, with its own options; beyond its end with
            --iterations.
        start_from: A checkpoint of another run as the start, for other options or another board.
        motions: Folder of reference motions of pushing (.npy, see `husky-sysid motions`) instead of the shipped ones; the run
            keeps a copy.
        minutes: Stop, with a checkpoint, after so much time.
        force: Train even if the board has not passed `check`.
    """
    printer = Printer(common)
    if resume is not None and start_from is not None:
        raise SysidError("--resume goes on with a run, --from begins a new one; give one of them.")
    record = common.space.load_board(board)
    _gate(record, force, printer)
    _require_mjlab()
    machines.torchrun(1)
    if machines.node > 0:
        return _join(resume or output, 1 if gpus is None else int(gpus), minutes, machines, printer)
    if resume is not None:
        folder = RunFolder(resume)
        config = _require_same_board(folder, record)
        count = folder.gpus() if gpus is None else int(gpus)
        _require_gpus(count)
        _say_unused(variant, learner, {"output": output, "motions": motions}, config, printer)
        if _has_more_to_do(folder, config, learner, printer):
            _run(folder, count, minutes, printer, machines)
    else:
        count = 1 if gpus is None else int(gpus)
        _require_gpus(count)
        folder = _new_run(record, output, common, printer)
        done = 0 if start_from is None else _iterations_of(start_from)
        config = RunConfig(task=variant.options(), learn=learner.options(done))
        clips = [] if motions is None else [motions]
        folder.begin(config, common.space.board_path(board), start_from, gpus=count, motions=clips)
        try:
            _run(folder, count, minutes, printer, machines)
        finally:
            if not folder.has_learned():
                folder.discard()
    rows = folder.read_curves()
    if not rows:
        raise SysidError(f"{folder.path}: the run ended before its first iteration; see the messages above.")
    from policy_runtime.learning.curves import draw_curves

    picture = draw_curves(rows, folder.path / "curves.png", folder.path.name)
    last = rows[-1]
    printer.say(f"{last['iteration']:.0f} iterations, {last['samples']:,.0f} steps of the world")
    printer.say(f"survival {last['survival']:.2f}, speed error {last['speed_error']:.3f} m/s")
    printer.say(f"policy   {folder.policy}")
    printer.say(f"curves   {picture}")
    printer.result({"run": str(folder.path), "policy": str(folder.policy), "last": last})
    return 0


def _gate(record: Board, force: bool, printer: Printer) -> None:
    if record.passed:
        return
    if not force:
        raise QualityGateError(
            f"the current record of board '{record.name}' has not passed `check`: a policy for it may not fit the real board. "
            f"Run {printer.common.space.command('check', *record.options, logs=())}, or train anyway with --force."
        )
    printer.warn(f"board '{record.name}' has not passed its check; training anyway")


def _require_gpus(count: int) -> None:
    import torch

    found = torch.cuda.device_count()
    if count > found:
        raise SysidError(
            f"--gpus {count}: PyTorch sees {found} GPUs here. Train on fewer, or slowly on the processor with --gpus 0."
        )


def _require_mjlab() -> None:
    missing = [name for name in ("torch", "mjlab", "rsl_rl") if find_spec(name) is None]
    if missing:
        raise SysidError(
            f"training needs {', '.join(missing)}, which is not installed: {install_extra('train')}."
        )


def _require_same_board(folder: RunFolder, record: Board) -> RunConfig:
    config = folder.read_config()
    name = load_board(folder.board).name
    if name != record.name:
        raise SysidError(
            f"{folder.path}: a run for board '{name}', not '{record.name}'. To go on with another board, begin a run "
            f"with --from and a checkpoint of this one."
        )
    return config


def _say_unused(
    variant: Variant, learner: Learner, paths: dict[str, Path | None], config: RunConfig, printer: Printer
) -> None:
    """Warn of options that a continued run ignores, because it has its own."""
    pairs = (
        (variant.options(), Variant().options(), config.task),
        (replace(learner, iterations=None).options(), Learner().options(), config.learn),
    )
    unused = [name for name, path in paths.items() if path is not None]
    for given, default, own in pairs:
        for field in fields(given):
            value = getattr(given, field.name)
            if value != getattr(default, field.name) and value != getattr(own, field.name):
                unused.append("coupling" if field.name == "steered" else field.name)
    if unused:
        names = ", ".join("--" + name.replace("_", "-") for name in dict.fromkeys(unused))
        printer.warn(
            f"not used: {names}. --resume goes on with the run's own options (config.toml); begin a new run with "
            "--from and a checkpoint of this one for others."
        )


def _join(path: Path | None, gpus: int, minutes: float, machines: Machines, printer: Printer) -> int:
    """Join a run of machine 0."""
    if path is None:
        raise SysidError(
            f"--node {machines.node}: name the run's folder, which machine 0 shares, by --output."
        )
    _require_gpus(gpus)
    _run(RunFolder(path), gpus, minutes, printer, machines)
    return 0


def _has_more_to_do(folder: RunFolder, config: RunConfig, learner: Learner, printer: Printer) -> bool:
    """Whether a run has iterations left; a new total is written into its configuration."""
    if not folder.checkpoints():
        raise SysidError(
            f"{folder.path}: holds no checkpoint to go on from (checkpoints/model_N.pt). Put them back, or begin a "
            "new run without --resume."
        )
    _iterations_of(folder.checkpoints()[-1])
    total = config.learn.iterations if learner.iterations is None else learner.iterations
    if learner.iterations is not None and total < folder.done():
        raise SysidError(
            f"--iterations {total}: the run has done {folder.done()} already, and this is the number in all."
        )
    if total != config.learn.iterations:
        folder.write_config(replace(config, learn=replace(config.learn, iterations=total)))
        printer.note(f"{folder.path}: {total} iterations in all instead of {config.learn.iterations}")
    if folder.done() >= total:
        printer.warn(
            f"{folder.path}: all of its {total} iterations are done; go on with a larger --iterations."
        )
    return folder.done() < total


def _iterations_of(checkpoint: Path) -> int:
    """Return the iterations of a checkpoint; reading it here reports a damaged one in one line."""
    from policy_runtime.learning.checkpoint import read_checkpoint

    return int(read_checkpoint(checkpoint)["iteration"])


def _new_run(record: Board, output: Path | None, common: Common, printer: Printer) -> RunFolder:
    path = next_run(common.space.outputs(record.name)) if output is None else output
    if (path / "config.toml").exists():
        raise SysidError(f"{path}: holds a run already. Go on with it by --resume {path}, or choose another.")
    printer.note(f"run folder {path}")
    return RunFolder(path)


def _run(
    folder: RunFolder, gpus: int, minutes: float, printer: Printer, machines: Machines = Machines()
) -> None:
    """Train in separate processes, so that a crash is reported and leaves the files intact."""
    command = [sys.executable, "-m"]
    if gpus > 1 or machines.nodes > 1:
        command += ["torch.distributed.run", *machines.torchrun(gpus), "-m"]
    command += ["policy_runtime.train", str(folder.path), "--device", "cuda" if gpus else "cpu"]
    if math.isfinite(minutes):
        command += ["--minutes", str(minutes)]
    code = subprocess.run(command, check=False, stdout=sys.stderr).returncode
    if code != 0:
        advice = (
            f"Go on from the newest checkpoint with --resume {folder.path}."
            if folder.done() and folder.has_learned()
            else "It had not come to a checkpoint: mend the cause and begin again."
        )
        raise SysidError(
            f"{folder.path}: training stopped with code {code}; its messages are above. {advice}"
        )
    printer.note("training is done")
