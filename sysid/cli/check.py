"""`husky-sysid check`: the gate between a measured board and training."""

from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Literal

from sysid.cli.console import Common, Printer, require_share
from sysid.cli.drive_options import DriveArguments
from sysid.cli.log_options import LogArguments, load_recordings, refuse_overwriting_logs
from sysid.cli.subject import Subject
from sysid.errors import QualityGateError, SysidError


def check(
    logs: list[Path],
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
    """Release the deck in the training scene as it was released in the logs, and compare.

    Args:
        logs: Measured decays.
        subject: Whose joint it is; that of a model is let go in the model itself.
        tolerance: Largest accepted NRMSE: RMS error over RMS of the measured roll about rest, sensor noise
            taken out.
        scene_file: An MJCF scene with a board in it to check instead of the one that the tool builds; --joint names its
            tilt joint, if that is not board_tilt_joint.
        timestep: Step in s; 0.005, or that of the scene file or model, if left out.
        integrator: MuJoCo integrator of the scene that the tool builds.
        coupling: How tilt steers the trucks in it: a joint equality, or trucks set directly after each step.
        export: Which parameters are written into it: compensated so that the scene as a whole decays like
            the board, for the step alone, or not at all.

    Raises:
        QualityGateError: The scene does not decay as measured.
    """
    from sim.board.bodies import TILT_JOINT
    from sim.check.verdict import judge
    from sim.compensation.scene import bench_scene, compensate, scene_from_file, training_scene
    from sysid.cli.bars import working
    from sysid.progress import stage

    require_share("--tolerance", tolerance)
    if drive.given:
        from sysid.cli.driven import driven_check, run_driven

        run_driven(
            lambda joints, out: driven_check(joints, out, tolerance),
            "check",
            logs,
            subject,
            drive,
            arguments,
            common,
        )
        return 0
    if timestep is not None and not 0 < timestep <= 0.05:
        raise SysidError(f"--timestep {timestep:g}: expected seconds between 0 and 0.05, such as 0.005.")
    printer = Printer(common)
    record = (subject if scene_file is None else replace(subject, joint=None)).load(common, printer)
    refuse_overwriting_logs([*logs, *([] if scene_file is None else [scene_file])], arguments, printer)
    recordings = load_recordings(logs, arguments, printer)
    releases = [release for recording in recordings for release in recording.releases]
    written = None
    if scene_file is not None:
        given = {"--integrator": integrator, "--coupling": coupling, "--export": export}
        usual = {"--integrator": "implicitfast", "--coupling": "equality", "--export": "in-scene"}
        if unused := [option for option, value in given.items() if value != usual[option]]:
            printer.warn(f"not used: {', '.join(unused)}, which are for the scene that the tool builds")
        scene = scene_from_file(scene_file, joint=subject.joint or TILT_JOINT, timestep=timestep)
    elif record.model:
        from sim.model.scene import scene_of
        from sim.model.setup import Setup

        scene = scene_of(Setup.of_entry(record.model), timestep=timestep)
    else:
        step = timestep or 0.005
        alone = not record.geometry
        with working(printer), stage(0.0, 1.0, "compensating the step"):
            kind = "step-compensated" if alone and export == "in-scene" else export
            written = compensate(record, kind, timestep=step, integrator=integrator, coupling=coupling)
        printer.note("; ".join(written.lines()))
        if alone:
            scene = bench_scene(written.board, timestep=step, integrator=integrator)
        else:
            scene = training_scene(written.board, timestep=step, integrator=integrator, coupling=coupling)
    with working(printer), stage(0.0, 1.0, "letting go in the scene"):
        verdict = judge(record, scene, releases, tolerance=tolerance)
    if written and not verdict.passed and written.step_error > tolerance / 2:
        cost = f"the {1e3 * written.timestep:g} ms step and the export alone cost {100 * written.step_error:.1f} %"
        verdict = replace(verdict, reasons=(*verdict.reasons, f"{cost}: choose a smaller --timestep"))
    for note in verdict.notes:
        printer.note(note)
    printer.say(verdict.report(printer.width))
    printer.result(verdict.to_json())
    if subject.model is not None:
        printer.note("no record is changed: the model itself was checked")
    elif scene_file is None:
        decays = verdict.case.decays
        entry = {
            "passed": verdict.passed,
            "nrmse": float(f"{decays.nrmse:.4g}"),
            "tolerance": decays.tolerance,
            "scene": verdict.case.scene.name,
            "logs": [str(log) for log in logs],
            "date": date.today().isoformat(),
        }
        path = common.space.save_board(record.checked(entry), since=record)
        printer.note(f"written into {path}")
    else:
        printer.note("the board record is unchanged: its [check] speaks of the scene that the tool builds")
    if not verdict.passed:
        raise QualityGateError(verdict.refusal())
    printer.warnings(verdict.warnings)
    return 0
