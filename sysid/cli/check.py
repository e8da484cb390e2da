"""`husky-sysid check`: the gate between a measured joint and training."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from cyclopts import Group, Parameter

from sysid.cli.console import Coupling, Printer, Step, Tolerance
from sysid.cli.measurement import DriveMeasurement, MeasuredLogs, read_logs
from sysid.errors import QualityGateError, UsageError


@Parameter(name="*", group=Group("Scene", sort_key=1))
@dataclass(frozen=True, kw_only=True)
class SceneArguments:
    """The scene of the check."""

    scene_file: Path | None = None
    """An MJCF scene with a board, instead of the built one. --joint names its tilt joint (default board_tilt_joint)."""
    timestep: Step | None = None
    """Step in s; 0.005, or that of the scene file or model, if left out."""
    coupling: Coupling = "equality"
    """Steering of the built scene's trucks by tilt: a joint equality, or set directly after each step."""
    export: Literal["in-scene", "step-compensated", "physical"] = "in-scene"
    """Parameters of the built scene: compensated for the whole scene, for the step alone, or not at all."""


def check(
    logs: tuple[Path, ...] = (),
    /,
    *,
    measurement: DriveMeasurement = DriveMeasurement(),
    tolerance: Tolerance = 0.02,
    scene: SceneArguments = SceneArguments(),
) -> None:
    """Release the joint in its MuJoCo scene as in the logs, and compare.

    Args:
        logs: Measured decays; those of the record's fit, if left out.
        measurement: Joint and reading of its logs; a model's joint is released in the model itself.
    """
    from sim.board.bodies import TILT_JOINT
    from sim.gate import check_joint
    from sysid.cli.bars import working

    if measurement.drive.given:
        from sysid.cli.driven import driven_replay, run_driven

        run_driven("check", partial(driven_replay, tolerance=tolerance, gate=True), logs, measurement)
        return
    printer = Printer(measurement.common)
    subject, file = measurement.subject, scene.scene_file
    if file is not None:
        if scene != SceneArguments(scene_file=file, timestep=scene.timestep):
            raise UsageError(
                "--coupling and --export are for the built scene. Leave them or --scene-file out."
            )
        printer.keep([file])
        measurement = replace(measurement, subject=replace(subject, joint=None))
    found = read_logs(measurement, logs, printer)
    releases = [release for recording in found.recordings for release in recording.releases]
    joint = subject.joint or TILT_JOINT
    with working(printer):
        verdict, written = check_joint(
            found.record, releases, tolerance=tolerance, scene_joint=joint, **vars(scene)
        )
    for note in (*(["; ".join(written.lines())] if written else []), *verdict.notes):
        printer.note(note)
    printer.say(verdict.report(printer.width))
    printer.result(verdict.to_json())
    if subject.model is not None:
        printer.note("no record is changed: the model itself was checked")
    elif file is not None:
        printer.note("the board record is unchanged: its [check] is of the built scene")
    else:
        checked = found.record.checked(verdict.entry())
        printer.note(f"written into {found.space.save_board(checked, since=found.record)}")
    if not verdict.passed:
        raise QualityGateError(verdict.refusal())
    printer.warnings(verdict.warnings)
    if file is None:
        printer.say(f"next: {_next_step(found)}")


def _next_step(found: MeasuredLogs) -> str:
    """Return the use of a joint that has passed."""
    record = found.record
    if record.model:
        return f"it is ready to use: {record.model['file']}"
    if record.geometry:
        return f"ready to train: {found.space.command('train', *record.options)}"
    words = ("mjcf", "--bench", "-o", f"{record.name}.xml")
    return f"write it as MJCF: {found.space.command(*words, *record.options)}"
