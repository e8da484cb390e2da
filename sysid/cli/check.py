"""`husky-sysid check`: the gate between a measured board and training."""

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from sysid.board import Board
from sysid.cli.console import Common, Printer, require_share
from sysid.cli.log_options import LogArguments, load_recordings, refuse_overwriting_logs
from sysid.cli.subject import Subject
from sysid.errors import QualityGateError, SysidError

if TYPE_CHECKING:
    from sim.check import SceneCheck
    from sim.compensation.parasitics import Parasitics, TiltJoint
    from sim.compensation.scene import ClampedScene

_NO_ARGUMENTS = LogArguments()
_NO_COMMON = Common()
_NO_SUBJECT = Subject()
TILT_JOINT = "board_tilt_joint"
"""Of the scenes that the tool builds."""


def check(
    logs: list[Path],
    /,
    *,
    subject: Subject = _NO_SUBJECT,
    tolerance: Annotated[float, Parameter(name="--tolerance")] = 0.02,
    scene_file: Annotated[Path | None, Parameter(name="--scene-file")] = None,
    timestep: Annotated[float | None, Parameter(name="--timestep")] = None,
    integrator: Annotated[str, Parameter(name="--integrator")] = "implicitfast",
    coupling: Annotated[Literal["equality", "direct"], Parameter(name="--coupling")] = "equality",
    export: Annotated[
        Literal["in-scene", "step-compensated", "physical"], Parameter(name="--export")
    ] = "in-scene",
    arguments: LogArguments = _NO_ARGUMENTS,
    common: Common = _NO_COMMON,
) -> int:
    """Release the deck in the training scene as it was released in the logs, and compare.

    Args:
        logs: Measured decays.
        subject: Whose joint it is.
        tolerance: Largest accepted NRMSE: RMS error over RMS of the measured roll about rest, sensor noise
            taken out.
        scene_file: An MJCF scene with a board in it to check instead of the one that the tool builds; --joint names its
            tilt joint.
        timestep: Step in s; 0.005, or that of the scene file or model, if left out.
        integrator: MuJoCo integrator of the scene that the tool builds.
        coupling: How tilt steers the trucks in it: a joint equality, or trucks set directly after each step.
        export: Which parameters are written into it: compensated so that the scene as a whole decays like
            the board, for the step alone, or not at all.
        arguments: How logs are read.
        common: Options of every command.

    Raises:
        QualityGateError: The scene does not decay as measured.
    """
    from sim.check import check_scene
    from sim.compensation.parasitics import measure_parasitics
    from sim.mjcf import substituted

    require_share("--tolerance", tolerance)
    if timestep is not None and not 0 < timestep <= 0.05:
        raise SysidError(f"--timestep {timestep:g}: expected seconds between 0 and 0.05, such as 0.005.")
    printer = Printer(common)
    tilt_joint = TILT_JOINT if subject.joint is None else subject.joint
    if scene_file is not None:
        subject = replace(subject, joint=None)
    record = subject.load(common, printer)
    refuse_overwriting_logs([*logs, *([] if scene_file is None else [scene_file])], arguments, printer)
    recordings = load_recordings(logs, arguments, printer)
    releases = [release for recording in recordings for release in recording.releases]
    if scene_file is not None:
        from sim.compensation.scene import scene_from_file

        given = {"--integrator": integrator, "--coupling": coupling, "--export": export}
        usual = {"--integrator": "implicitfast", "--coupling": "equality", "--export": "in-scene"}
        if unused := [option for option, value in given.items() if value != usual[option]]:
            printer.warn(f"not used: {', '.join(unused)}, which are for the scene that the tool builds")
        scene = scene_from_file(scene_file, joint=tilt_joint, timestep=timestep)
    elif record.model:
        from sim.model.scene import scene_of
        from sim.model.setup import Setup

        scene = scene_of(Setup.of_entry(record.model), timestep=timestep)
    else:
        scene = _own_scene(
            record, 0.005 if timestep is None else timestep, integrator, coupling, export, printer
        )
    result = check_scene(record, scene, releases, tolerance=tolerance)
    additions = measure_parasitics(record, scene) if record.geometry else None
    unwritten = substituted(record)
    reasons = (*unwritten, *(additions.reasons(record, record.tilt["range"].value) if additions else ()))
    if result.only_rest_is_off:
        reasons = (
            f"the deck rests {math.degrees(result.rest_error):.2g}° from where the record lets the scene rest (fit the "
            "record to these logs, or level the sensor)",
        )
    _print(printer, record, scene, result, additions)
    printer.result(_json(record, scene, result, additions, () if result.passed else reasons))
    if subject.model is not None:
        printer.note("no record is changed: the model itself was checked")
    elif scene_file is None:
        path = common.space.save_board(record.checked(_entry(scene, result, logs)), since=record)
        printer.note(f"written into {path}")
    else:
        printer.note("the board record is unchanged: its [check] speaks of the scene that the tool builds")
    if result.passed:
        printer.say(
            f"passed: NRMSE {100 * result.nrmse:.2f} % (tolerance {100 * tolerance:g} %; an error below "
            f"{100 * result.hidden:.1f} % could not be seen in this noise)"
        )
        for line in unwritten:
            printer.warn(f"{line}: the scene passes all the same")
        if result.hidden > tolerance:
            printer.warn("the logs are too noisy to tell: record longer, more often, or with a better sensor")
        return 0
    why = "; ".join(reasons) or (
        f"no part of the scene stands out. If the logs are of another joint than '{record.name}', name that; else fit it to "
        "them, or diagnose them"
    )
    raise QualityGateError(
        f"the scene does not decay like '{record.name}': NRMSE {100 * result.nrmse:.1f} %, tolerance "
        f"{100 * tolerance:g} %. Why: {why}."
    )


def _own_scene(
    record: Board,
    timestep: float,
    integrator: str,
    coupling: Literal["equality", "direct"],
    export: str,
    printer: Printer,
) -> "ClampedScene":
    from sim.compensation.scene import bench_scene, compensate_in_scene, training_scene
    from sim.compensation.step import compensate_step

    written = record
    if export != "physical":
        if export == "in-scene" and record.geometry:
            done = compensate_in_scene(record, timestep=timestep, integrator=integrator, coupling=coupling)
        else:
            done = compensate_step(record, timestep=timestep, integrator=integrator)
        written = done.board
        printer.note("; ".join(done.lines()))
    if not record.geometry:
        printer.note(
            "the record has no [geometry], so there is no board to stand on its wheels: the joint alone is checked"
        )
        return bench_scene(written, timestep=timestep, integrator=integrator)
    return training_scene(written, timestep=timestep, integrator=integrator, coupling=coupling)


def _print(
    printer: Printer,
    record: Board,
    scene: "ClampedScene",
    result: "SceneCheck",
    additions: "Parasitics | None",
) -> None:
    printer.say(f"{record.name} in: {scene.name}; all but what decays is held, as on a bench")
    for release in result.releases:
        if release.cut > 0:
            printer.note(
                f"{release.log}, release {release.number}: the first {1e3 * release.cut:.0f} ms are beyond the scene's "
                f"tilt range of ±{scene.tilt_range:.3g} rad and are left out"
            )
    printer.table(
        ("log", "release", "from", "to compare", "NRMSE", "RMSE with noise"),
        [
            (
                release.log,
                str(release.number),
                release.side,
                f"{release.time[-1] - release.time[0]:.2f} s",
                f"{100 * release.nrmse:.2f} %",
                f"{1e3 * release.rmse:.2f} mrad",
            )
            for release in result.releases
        ],
    )
    if additions is None:
        return
    rows = [("wanted at this step", additions.wanted), ("the scene as a whole", additions.whole)]
    rows += [
        (name if name == "deck alone" else f"contribution of {name}", part) for name, part in additions.parts
    ]
    printer.table(
        ("tilt joint", "stiffness N·m/rad", "damping N·m·s/rad", "inertia kg·m²"),
        [
            (name, f"{part.stiffness:.4g}", f"{part.damping:.4g}", f"{part.inertia:.4g}")
            for name, part in ((name, _rounded(part, additions.wanted)) for name, part in rows)
        ],
    )


def _rounded(part: "TiltJoint", wanted: "TiltJoint") -> "TiltJoint":
    """Drop what is below a millionth of the board's own: rounding of the simulation."""
    return type(part)(
        *(
            0.0 if abs(value) < 1e-6 * abs(own) else value
            for value, own in (
                (part.stiffness, wanted.stiffness),
                (part.damping, wanted.damping),
                (part.inertia, wanted.inertia),
            )
        )
    )


def _entry(scene: "ClampedScene", result: "SceneCheck", logs: Sequence[Path]) -> dict[str, Any]:
    return {
        "passed": result.passed,
        "nrmse": float(f"{result.nrmse:.4g}"),
        "tolerance": result.tolerance,
        "scene": scene.name,
        "logs": [str(log) for log in logs],
        "date": date.today().isoformat(),
    }


def _json(
    record: Board,
    scene: "ClampedScene",
    result: "SceneCheck",
    additions: "Parasitics | None",
    reasons: Sequence[str],
) -> dict[str, Any]:
    def numbers(joint: "TiltJoint") -> dict[str, float]:
        return {
            "stiffness_nm_rad": joint.stiffness,
            "damping_nms_rad": joint.damping,
            "inertia_kgm2": joint.inertia,
        }

    return {
        "board": record.name,
        "scene": scene.name,
        "passed": result.passed,
        "nrmse": result.nrmse,
        "tolerance": result.tolerance,
        "nrmse_hidden_by_noise": result.hidden,
        "rmse_rad": result.rmse,
        "releases": [
            {
                "log": release.log,
                "release": release.number,
                "side": release.side,
                "t_start_s": float(release.time[0]),
                "t_end_s": float(release.time[-1]),
                "left_out_s": release.cut,
                "nrmse": release.nrmse,
                "rmse_rad": release.rmse,
                "zero_rad": release.zero,
                "rest_error_rad": release.rest_error,
            }
            for release in result.releases
        ],
        "tilt_joint": None
        if additions is None
        else {
            "wanted": numbers(additions.wanted),
            "whole": numbers(additions.whole),
            "parts": {name: numbers(part) for name, part in additions.parts},
        },
        "reasons": list(reasons),
    }
