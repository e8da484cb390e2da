"""`husky-sysid check`: the gate between a measured board and training."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

from sysid.cli.console import Common, Printer, require_share
from sysid.cli.drive_options import DriveArguments
from sysid.cli.log_options import LogArguments, load_recordings, refuse_overwriting_logs, space_of
from sysid.cli.subject import Subject
from sysid.cli.view import logs_or_fitted
from sysid.errors import QualityGateError


def check(
    logs: tuple[Path, ...] = (),
    /,
    *,
    subject: Subject = Subject(),
    tolerance: float = 0.02,
    scene_file: Path | None = None,
    timestep: float | None = None,
    integrator: str = "implicitfast",
    coupling: Literal["equality", "direct"] = "equality",
    export: Literal["in-scene", "step-compensated", "physical"] = "in-scene",
    drive: DriveArguments = DriveArguments(),
    arguments: LogArguments = LogArguments(),
    common: Common = Common(),
) -> int:
    """Release the deck in the training scene as in the logs, and compare.

    Args:
        logs: Measured decays; those of the record's fit, if left out.
        subject: Board or joint; a model's joint is released in the model itself.
        tolerance: Largest accepted NRMSE: RMS error without sensor noise, over RMS of the measured roll about rest.
        scene_file: An MJCF scene with a board, instead of the built one. --joint names its tilt joint (default
            board_tilt_joint).
        timestep: Step in s; 0.005, or that of the scene file or model, if left out.
        integrator: MuJoCo integrator of the built scene.
        coupling: Steering of its trucks by tilt: a joint equality, or set directly after each step.
        export: Parameters of the built scene: compensated for the whole scene, for the step alone, or not at all.

    Raises:
        QualityGateError: The scene does not decay as measured.
    """
    from sim.board.bodies import TILT_JOINT
    from sim.gate import GateOptions, check_joint
    from sysid.cli.bars import working

    require_share("--tolerance", tolerance)
    if drive.given:
        from sysid.cli.driven import driven_check, run_driven

        run = partial(driven_check, tolerance=tolerance)
        return run_driven("check", run, logs, subject, drive, arguments, common)
    printer = Printer(common)
    record = (subject if scene_file is None else replace(subject, joint=None)).load(common, printer)
    refuse_overwriting_logs([*logs, *([] if scene_file is None else [scene_file])], arguments, printer)
    found, arguments = logs_or_fitted(record, logs, arguments, printer)
    recordings = load_recordings(found, arguments, printer, rest=record.rest_angle)
    releases = [release for recording in recordings for release in recording.releases]
    options = GateOptions(
        scene_file=scene_file, scene_joint=subject.joint or TILT_JOINT, timestep=timestep, integrator=integrator,
        coupling=coupling, export=export,
    )  # fmt: skip
    if scene_file is not None:
        usual = GateOptions()
        names = ("integrator", "coupling", "export")
        if unused := [f"--{name}" for name in names if getattr(options, name) != getattr(usual, name)]:
            printer.warn(f"not used: {', '.join(unused)}, which are for the built scene")
    with working(printer):
        gate = check_joint(record, releases, tolerance=tolerance, options=options)
    verdict = gate.verdict
    if gate.written is not None:
        printer.note("; ".join(gate.written.lines()))
    for note in verdict.notes:
        printer.note(note)
    printer.say(verdict.report(printer.width))
    printer.result(verdict.to_json())
    if subject.model is not None:
        printer.note("no record is changed: the model itself was checked")
    elif scene_file is None:
        path = common.space.save_board(record.checked(verdict.entry()), since=record)
        printer.note(f"written into {path}")
    else:
        printer.note("the board record is unchanged: its [check] is of the built scene")
    if not verdict.passed:
        raise QualityGateError(verdict.refusal())
    printer.warnings(verdict.warnings)
    if record.model:
        printer.say(f"next: it is ready to use: {record.model['file']}")
    elif scene_file is None:
        why, words = (
            ("ready to train", ("train",))
            if record.geometry
            else ("write it as MJCF", ("mjcf", "--bench", "-o", f"{record.name}.xml"))
        )
        printer.say(f"next: {why}: {space_of(common, arguments).command(*words, *record.options)}")
    return 0
