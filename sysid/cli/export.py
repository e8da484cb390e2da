"""`husky-sysid export`: pack scene, policy and board record into one folder."""

from dataclasses import dataclass
from pathlib import Path

from cyclopts import Parameter

from sysid.cli.console import BoardName, Common, Coupling, Output, Printer, Step, Terrain
from sysid.errors import UsageError


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class World:
    """The scene of the folder."""

    policy: Path | None = None
    """ONNX policy to include."""
    coupling: Coupling = "equality"
    """Steering of the trucks by the deck's tilt."""
    terrain: Terrain = "flat"
    """The ground."""
    force: bool = False
    """Export even if policy and board disagree, or the board has not passed `check`."""


def export(
    *,
    board: BoardName | None = None,
    mjlab: Path | None = None,
    timestep: Step = 0.005,
    world: World = World(),
    output: Output | None = None,
    common: Common = Common(),
) -> None:
    """Pack scene, policy and board record into one folder that runs by itself.

    Args:
        board: The board.
        mjlab: Fit of driven joints (fit.json): write it as a module with mjlab's actuators and randomisation, and as JSON.
        timestep: Physics step of the training in s; mjlab counts delays in steps.
        output: The folder; reports/BOARD/export of the workspace if not given.
    """
    from policy_runtime.export import export_folder

    printer = Printer(common)
    if mjlab is not None:
        from sysid.cli.driven import driven_export

        printer.result(driven_export(mjlab, output, timestep, printer))
        return
    if board is None:
        raise UsageError(
            "export what? Name a board (--board), or the fit of driven joints (--mjlab fit.json)."
        )
    printer.keep([world.policy] if world.policy else [])
    record = common.space.load_board(board)
    printer.require_passed(record, force=True)
    folder = output or common.space.outputs(board) / "export"
    files = export_folder(record, folder, **vars(world))
    size = sum(path.stat().st_size for path in files)
    printer.say(f"{folder}: {len(files)} files, {size / 1e6:.1f} MB")
    content = {"folder": folder, "board": record.name, "board_passed": record.passed}
    printer.result({**content, "policy": world.policy, "files": files, "bytes": size})
