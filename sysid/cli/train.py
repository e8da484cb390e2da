"""`husky-sysid train`: a policy for a board."""

import math
import subprocess
import sys
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from policy_runtime.learning.run_folder import LearnOptions, RunConfig, RunFolder, next_run
from sim.skate.cycle.start import AT_REST, Start
from sim.skate.options import SkateOptions
from sysid.board import Board, load_board
from sysid.cli.console import BoardName, Common, Output, Printer, Texts
from sysid.errors import SysidError, UsageError, install_extra


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of task and learner; a continued run has its own."""

    environments: Annotated[int, Parameter(validator=Number(gte=1))] = LearnOptions().environments
    """Worlds on each GPU."""
    iterations: Annotated[int | None, Parameter(validator=Number(gte=1))] = None
    """Iterations in all: 3000 for a new run, and with --from as many beyond that checkpoint; with --resume the new total."""
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = LearnOptions().seed
    """Seed of everything random."""
    start: Literal["mixed", "standing"] = "mixed"
    """Start of the episodes: half at rest and the others anywhere in the cycle, or all at rest as in the paper."""
    change: Annotated[Texts, Parameter(name="--set")] = ()
    """Change another option of config.toml, as NAME=VALUE (docs/task.md lists the paper's variants); repeat it for several."""
    motions: Path | None = None
    """Folder of reference motions of pushing (.npy, see `husky-sysid motions`) instead of the shipped ones; the run keeps a
    copy."""

    def config(self, done: int = 0) -> RunConfig:
        """Return all options, for a run that begins after so many iterations."""
        iterations = done + LearnOptions().iterations if self.iterations is None else self.iterations
        if iterations <= done:
            raise SysidError(
                f"--iterations {iterations}: that checkpoint has done {done} already, and this is the number in all."
            )
        learn = LearnOptions(environments=self.environments, iterations=iterations, seed=self.seed)
        config = RunConfig(
            task=SkateOptions(start=Start() if self.start == "mixed" else AT_REST), learn=learn
        )
        for text in self.change:
            config = config.changed(text)
        return config


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Effort:
    """Time and processors of a run."""

    gpus: Literal[0, 1, 2, 4, 8] | None = None
    """Number of GPUs, one process each; 0 trains on the CPU, for a trial. Default: 1, and with --resume that of the run."""
    minutes: Annotated[float, Parameter(validator=Number(gt=0))] = math.inf
    """Stop, with a checkpoint, after so much time."""


def train(
    *,
    board: BoardName | None = None,
    options: Options = Options(),
    effort: Effort = Effort(),
    output: Output | None = None,
    resume: Path | None = None,
    start_from: Annotated[Path | None, Parameter(name="--from")] = None,
    force: bool = False,
    common: Common = Common(),
) -> None:
    """Train a policy for a board.

    Args:
        board: Name of the board; a run that goes on by --resume has its own.
        output: Folder of the run; the default is reports/BOARD/train-N.
        resume: Folder of a run to continue from its newest checkpoint; beyond its end with --iterations.
        start_from: A checkpoint of another run as the start, for other options or another board.
        force: Train even if the board has not passed `check`.
    """
    printer = Printer(common)
    if resume is not None and (start_from or output):
        raise UsageError(
            "--resume goes on with a run in its own folder. Leave --from and --output out, or begin a new run without --resume."
        )
    record = _record(board, resume, common)
    printer.require_passed(record, force=force)
    missing = [name for name in ("torch", "mjlab", "rsl_rl") if find_spec(name) is None]
    if missing:
        raise SysidError(
            f"training needs {', '.join(missing)}, which is not installed: {install_extra('train')}."
        )
    if resume is not None:
        folder = _resume(resume, record, options, effort, printer)
    else:
        folder = RunFolder(output or next_run(common.space.outputs(record.name)))
        _begin(folder, common.space.board_path(record.name), options, start_from, effort, printer)
    rows = folder.read_curves()
    if not rows:
        raise SysidError(f"{folder.path}: the run ended before its first iteration; see the messages above.")
    from policy_runtime.learning.curves import draw_curves

    picture = draw_curves(rows, folder.path / "curves.png", folder.path.name)
    last = rows[-1]
    printer.say(f"{last['iteration']:.0f} iterations, {last['samples']:,.0f} steps of the world")
    printer.say(f"survival {last['survival']:.2f}, speed error {last['speed_error']:.3f} m/s")
    printer.result(
        {"run": str(folder.path), "policy": str(folder.policy), "last": last}, folder.policy, picture
    )


def _record(board: str | None, resume: Path | None, common: Common) -> Board:
    if board is not None:
        return common.space.load_board(board)
    if resume is None:
        raise UsageError("train for which board? Name it by --board.")
    folder = RunFolder(resume)
    folder.read_config()  # refuses a folder without a run
    return load_board(folder.board)


def _begin(
    folder: RunFolder,
    record: Path,
    options: Options,
    start_from: Path | None,
    effort: Effort,
    printer: Printer,
) -> None:
    """Begin a run in a new folder, which goes again if nothing was learned."""
    if folder.config.exists():
        raise SysidError(
            f"{folder.path}: holds a run already. Go on with it by --resume {folder.path}, or choose another."
        )
    printer.note(f"run folder {folder.path}")
    config = options.config(0 if start_from is None else _iterations_of(start_from))
    clips = [] if options.motions is None else [options.motions]
    folder.begin(config, record, start_from, gpus=1 if effort.gpus is None else effort.gpus, motions=clips)
    try:
        _run(folder, effort, printer)
    finally:
        if not folder.has_learned():
            folder.discard()


def _resume(path: Path, record: Board, options: Options, effort: Effort, printer: Printer) -> RunFolder:
    """Go on with a run, if it has iterations left; a new total is written into its configuration."""
    folder = RunFolder(path)
    config, name = folder.read_config(), load_board(folder.board).name
    if name != record.name:
        raise SysidError(
            f"{path}: a run for board '{name}', not '{record.name}'. To go on with another board, begin a run "
            f"with --from and a checkpoint of this one."
        )
    if options != Options(iterations=options.iterations):
        raise UsageError(
            f"--resume goes on with the run's own options ({folder.config}); only --iterations may change. Begin a new run "
            "with --from and a checkpoint of this one for others."
        )
    if not folder.checkpoints():
        raise SysidError(
            f"{path}: holds no checkpoint to go on from (checkpoints/model_N.pt). Put them back, or begin a "
            "new run without --resume."
        )
    _iterations_of(folder.checkpoints()[-1])
    total = options.iterations or config.learn.iterations
    if total < folder.done() and options.iterations:
        raise SysidError(
            f"--iterations {total}: the run has done {folder.done()} already, and this is the number in all."
        )
    if total != config.learn.iterations:
        folder.write_config(replace(config, learn=replace(config.learn, iterations=total)))
        printer.note(f"{path}: {total} iterations in all instead of {config.learn.iterations}")
    if folder.done() >= total:
        printer.warn(f"{path}: all of its {total} iterations are done; go on with a larger --iterations.")
    else:
        gpus: Any = folder.gpus() if effort.gpus is None else effort.gpus
        _run(folder, replace(effort, gpus=gpus), printer)
    return folder


def _iterations_of(checkpoint: Path) -> int:
    """Return the iterations of a checkpoint; reading it here reports a damaged one in one line."""
    from policy_runtime.learning.checkpoint import read_checkpoint

    return int(read_checkpoint(checkpoint)["iteration"])


def _run(folder: RunFolder, effort: Effort, printer: Printer) -> None:
    """Train in separate processes, so that a crash is reported and leaves the files intact."""
    import torch

    gpus, found = 1 if effort.gpus is None else effort.gpus, torch.cuda.device_count()
    if gpus > found:
        raise SysidError(
            f"--gpus {gpus}: PyTorch sees {found} GPUs here. Train on fewer, or slowly on the processor with --gpus 0."
        )
    command = [sys.executable, "-m"]
    if gpus > 1:
        command += ["torch.distributed.run", "--standalone", f"--nproc-per-node={gpus}", "-m"]
    command += ["policy_runtime.train", str(folder.path), "--device", "cuda" if gpus else "cpu"]
    if math.isfinite(effort.minutes):
        command += ["--minutes", str(effort.minutes)]
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
