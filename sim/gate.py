"""The gate: the scene that a record means, and its verdict."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from sim.board.bodies import TILT_JOINT, Coupling
from sim.check.verdict import Verdict, judge
from sim.compensation.scene import Export, bench_scene, compensate, training_scene
from sim.compensation.step import Compensation
from sim.model.scene import scene_from_file, scene_of
from sim.model.setup import Setup
from sysid.board import Board
from sysid.errors import SysidError
from sysid.progress import stage
from sysid.roll import Release

LARGEST_STEP = 0.05
"""[s]."""


def check_joint(
    record: Board, releases: Sequence[Release], *, tolerance: float = 0.02, scene_file: Path | None = None,
    scene_joint: str = TILT_JOINT, timestep: float | None = None, coupling: Coupling = "equality",
    export: Export = "in-scene",
) -> tuple[Verdict, Compensation | None]:  # fmt: skip
    """Let a joint go in its scene as it was let go in the logs, and compare.

    The scene is the named file. Without one it is the model of a model's joint, the training scene of a board, or the clamped bench of a
    joint without geometry.

    Args:
        tolerance: Largest accepted NRMSE: RMS error over RMS of the measured motion about rest, sensor noise taken out [1].
        scene_file: An MJCF scene with the board in it, instead of the scene that is built.
        scene_joint: Its tilt joint.
        timestep: Step [s]; 0.005, or that of the scene file or model, if left out.
        coupling: How tilt steers the trucks of the scene that is built.
        export: Which parameters are written into it.

    Returns:
        The verdict, and the compensation of the time step that was written into the scene.

    Raises:
        SysidError: The tolerance or the step is out of range, or the scene cannot be built.
    """
    if not 0 < tolerance < 1:
        raise SysidError(f"--tolerance {tolerance:g}: expected a share between 0 and 1, such as 0.02.")
    if timestep is not None and not 0 < timestep <= LARGEST_STEP:
        raise SysidError(
            f"--timestep {timestep:g}: expected seconds between 0 and {LARGEST_STEP:g}, such as 0.005."
        )
    written = None
    if scene_file is not None:
        scene = scene_from_file(scene_file, joint=scene_joint, timestep=timestep)
    elif record.model:
        scene = scene_of(Setup.of_entry(record.model), timestep=timestep)
    else:
        step, alone = timestep or 0.005, not record.geometry
        if alone and export == "in-scene":
            export = "step-compensated"
        with stage(0.0, 0.5, "compensating the step"):
            written = compensate(record, export, timestep=step, coupling=coupling)
        if alone:
            scene = bench_scene(written.board, timestep=step)
        else:
            scene = training_scene(written.board, timestep=step, coupling=coupling)
    with stage(0.5, 1.0, "letting go in the scene"):
        verdict = judge(record, scene, releases, tolerance=tolerance)
    if written and not verdict.passed and written.step_error > tolerance / 2:
        cost = f"the {1e3 * written.timestep:g} ms step and the export alone cost {100 * written.step_error:.1f} %"
        verdict = replace(verdict, reasons=(*verdict.reasons, f"{cost}: choose a smaller --timestep"))
    return verdict, written
