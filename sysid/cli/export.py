"""`husky-sysid export`: pack scene, policy and board record into one folder."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from sysid.cli.console import Common, Output, Printer
from sysid.errors import UsageError


def export(
    *,
    board: Annotated[str | None, Parameter(name=("--board", "-b"))] = None,
    mjlab: Path | None = None,
    timestep: float = 0.005,
    policy: Path | None = None,
    output: Output | None = None,
    coupling: Literal["equality", "direct"] = "equality",
    terrain: Literal["flat", "slopes", "steps"] = "flat",
    force: bool = False,
    common: Common = Common(),
) -> int:
    """Pack scene, policy and board record into one folder that runs by itself.

    Run it with `husky-sysid run FOLDER` or `husky-sysid play FOLDER`, without mjlab and torch.

    Args:
        board: The board.
        mjlab: Fit of driven joints (fit.json): write it as a module with mjlab's actuators and randomisation, and as JSON.
        timestep: Physics step of the training in s; mjlab counts delays in steps.
        policy: ONNX policy to include.
        output: The folder; reports/BOARD/export of the workspace if not given.
        coupling: Steering of the trucks by the deck's tilt.
        terrain: The ground.
        force: Export even if policy and board disagree, or the board has not passed `check`.
    """
    from policy_runtime.export import export_folder

    printer = Printer(common)
    if mjlab is not None:
        from sysid.cli.driven import driven_export

        printer.result(driven_export(mjlab, output, timestep, printer))
        return 0
    if board is None:
        raise UsageError(
            "export what? Name a board (--board), or the fit of driven joints (--mjlab fit.json)."
        )
    printer.keep([] if policy is None else [policy])
    record = common.space.load_board(board)
    if not record.passed:
        printer.warn(f"board '{board}' has not passed `check`; the folder's manifest records it.")
    folder = output or common.space.outputs(board) / "export"
    files = export_folder(record, folder, policy=policy, coupling=coupling, terrain=terrain, force=force)
    size = sum(path.stat().st_size for path in files)
    printer.say(f"{folder}: {len(files)} files, {size / 1e6:.1f} MB")
    printer.result(
        {
            "folder": str(folder),
            "board": record.name,
            "board_passed": record.passed,
            "policy": None if policy is None else str(policy),
            "files": [str(path) for path in files],
            "bytes": size,
        }
    )
    return 0
