"""The gate: the scene that a record means, and its verdict."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from sim.board.bodies import TILT_JOINT, Coupling
from sim.check.verdict import Verdict, judge
from sim.compensation.scene import Export, bench_scene, compensate, scene_from_file, training_scene
from sim.compensation.step import Compensation
from sim.model.scene import scene_of
from sim.model.setup import Setup
from sysid.board import Board
from sysid.errors import SysidError
from sysid.progress import stage
from sysid.roll import Release

LARGEST_STEP = 0.05
"""[s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GateOptions:
    """The scene in which a joint is let go."""

    scene_file: Path | None = None
    """An MJCF scene with the board in it, instead of the scene that is built."""
    scene_joint: str = TILT_JOINT
    """Its tilt joint."""
    timestep: float | None = None
    """Step [s]; 0.005, or that of the scene file or model, if left out."""
    integrator: str = "implicitfast"
    """Of the scene that is built."""
    coupling: Coupling = "equality"
    """How tilt steers the trucks in it."""
    export: Export = "in-scene"
    """Which parameters are written into it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gate:
    """A verdict, and the compensation of the time step that was written into the scene."""

    verdict: Verdict
    written: Compensation | None


def check_joint(
    record: Board, releases: Sequence[Release], *, tolerance: float = 0.02, options: GateOptions | None = None
) -> Gate:
    """Let a joint go in its scene as it was let go in the logs, and compare.

    The scene is the named file. Without one it is the model of a model's joint, the training scene of a board, or the clamped bench of a
    joint without geometry.

    Args:
        tolerance: Largest accepted NRMSE: RMS error over RMS of the measured motion about rest, sensor noise taken out [1].

    Raises:
        SysidError: The tolerance or the step is out of range, or the scene cannot be built.
    """
    options = options or GateOptions()
    step = options.timestep
    if not 0 < tolerance < 1:
        raise SysidError(f"--tolerance {tolerance:g}: expected a share between 0 and 1, such as 0.02.")
    if step is not None and not 0 < step <= LARGEST_STEP:
        raise SysidError(
            f"--timestep {step:g}: expected seconds between 0 and {LARGEST_STEP:g}, such as 0.005."
        )
    written = None
    if options.scene_file is not None:
        scene = scene_from_file(options.scene_file, joint=options.scene_joint, timestep=step)
    elif record.model:
        scene = scene_of(Setup.of_entry(record.model), timestep=step)
    else:
        step, alone = step or 0.005, not record.geometry
        kind: Literal["in-scene", "step-compensated", "physical"] = options.export
        if alone and kind == "in-scene":
            kind = "step-compensated"
        integrator, coupling = options.integrator, options.coupling
        with stage(0.0, 0.5, "compensating the step"):
            written = compensate(record, kind, timestep=step, integrator=integrator, coupling=coupling)
        if alone:
            scene = bench_scene(written.board, timestep=step, integrator=integrator)
        else:
            scene = training_scene(written.board, timestep=step, integrator=integrator, coupling=coupling)
    with stage(0.5, 1.0, "letting go in the scene"):
        verdict = judge(record, scene, releases, tolerance=tolerance)
    if written and not verdict.passed and written.step_error > tolerance / 2:
        cost = f"the {1e3 * written.timestep:g} ms step and the export alone cost {100 * written.step_error:.1f} %"
        verdict = replace(verdict, reasons=(*verdict.reasons, f"{cost}: choose a smaller --timestep"))
    return Gate(verdict=verdict, written=written)
