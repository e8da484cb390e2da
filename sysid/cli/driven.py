"""Driven joints on the command line: `compare`, `diagnose`, `fit` and `check` with `--input`."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.cli.console import Printer
from sysid.cli.log_options import LogArguments, refuse_overwriting_logs, say_notes, typed
from sysid.cli.measurement import DriveMeasurement
from sysid.cli.parameter_options import parse_bounds, parse_fixed
from sysid.errors import QualityGateError, SysidError, UsageError
from sysid.files import refuse_overwriting, require_writable, write_atomically, write_json
from sysid.roll import Roll

if TYPE_CHECKING:
    from sim.model.driven import Stated
    from sim.model.setup import Setup
    from sysid.cli.fit import FitArguments
    from sysid.driven.log import DrivenLog, InputKind

EVERY = "all"
"""Joint name for all joints with an actuator."""


@dataclass(frozen=True, kw_only=True)
class Driven:
    """Logs of driven joints, and the model's facts about these joints."""

    setup: "Setup"
    joints: tuple[str, ...]
    logs: Mapping[str, "list[DrivenLog]"]
    """By joint, one for each file."""
    stated: "Mapping[str, Stated]"
    paths: Sequence[Path]
    measurement: DriveMeasurement
    """Options that named joint, input and columns."""

    def next_step(self, verb: str, why: str, *more: str, model: Path | None = None) -> str:
        """Return the next command: with the same options, `model` in place of the file, and for a check the rest of the log."""
        named = self.measurement
        if verb == "check" and named.reading.start is None:
            rest = replace(named.reading, start=named.reading.stop, stop=None)
            named = replace(named, reading=rest)
        subject = replace(named.subject, model=model or named.subject.model)
        command = named.space.command(verb, *typed(subject), *typed(named.drive), *more, logs=self.paths)
        return f"{why}: {command}"

    def smooth(self) -> "Driven":
        """Return it with an input that is smooth between samples in the next command."""
        drive = replace(self.measurement.drive, input_between="smooth")
        return replace(self, measurement=replace(self.measurement, drive=drive))

    @property
    def name(self) -> str:
        """Name of the outputs' folder."""
        joint = self.joints[0] if len(self.joints) == 1 else EVERY
        return f"{self.setup.file.stem}_{joint}".replace("/", "_")


def read_driven(paths: Sequence[Path], measurement: DriveMeasurement, printer: Printer) -> Driven:
    """Read logs of driven joints."""
    from sim.model.driven import Course, load_along, stated
    from sysid.driven.log import log_of

    drive, arguments = measurement.drive, measurement.reading
    if drive.input_is is None:
        raise UsageError("--input needs --input-is torque|force|current|voltage|command.")
    kind = drive.input_is
    setup = measurement.subject.setup
    if setup is None:
        raise UsageError("a driven joint needs its model: --model FILE --joint NAME (or --joint all).")
    if not paths:
        raise UsageError("no log was given.")
    refuse_overwriting_logs(paths, arguments, printer)
    joints, others = _joints(setup, printer)
    first = joints[0]
    setup = setup.with_(joint=first)
    logs: dict[str, list[DrivenLog]] = {joint: [] for joint in joints}
    for path in paths:
        motions, inputs, measured = _columns(path, joints, others, kind, arguments.column, drive.input)
        rolls = {
            joint: _roll(path, column, inputs.get(joint), arguments)
            for joint, column in (motions | measured).items()
        }
        say_notes(path, rolls[first], printer)
        clock = rolls[first].time
        zeros = {joint: drive.zero * roll.unit_size for joint, roll in rolls.items()}
        angles = {
            joint: _near(np.interp(clock, roll.time, roll.roll) - zeros[joint], slides=roll.slides)
            for joint, roll in rolls.items()
        }
        courses = {joint: Course.measured(clock, angle) for joint, angle in angles.items()}
        for joint in joints:
            roll = replace(rolls[joint], time=clock, roll=angles[joint])
            load = load_along(setup.with_(joint=joint), courses)
            size = _size(inputs[joint], kind, measurement, roll)
            one = log_of(roll, inputs[joint], kind, scale=size or 1.0, load=load)
            if kind == "command":
                one = _like_position(one, zeros[joint], known=size is not None)
            beside = {name: angles[name] for name in measured}
            held = {"auto": None, "held": True, "smooth": False}[drive.input_between]
            logs[joint].append(replace(one, held=held, beside=beside))
            printer.note(
                f"joint '{joint}': position from {motions[joint] or 'the log'}, {kind} from {inputs[joint]}"
            )
        for joint, column in measured.items():
            printer.note(f"joint '{joint}': moves as measured in {column}")
        if held := [joint for joint in others if joint not in measured]:
            printer.note(f"held in the pose of the model: {', '.join(held)}")
    known = {joint: stated(setup.with_(joint=joint), kind, drive.gains, drive.encoder) for joint in joints}
    return Driven(setup=setup, joints=joints, logs=logs, stated=known, paths=paths, measurement=measurement)


def _columns(
    path: Path, joints: Sequence[str], others: Sequence[str], kind: "InputKind", motion: str | None, acted: str | None
) -> tuple[dict[str, str | None], dict[str, str], dict[str, str]]:  # fmt: skip
    """Return the columns of motion and input of each joint in a log, and those of the other joints' motion."""
    from sysid.driven import columns
    from sysid.logs.formats.registry import open_log

    names = open_log(path).names
    measured = {
        joint: column for joint in others if (column := columns.column_of(names, joint, columns.MOTIONS))
    }
    if len(joints) == 1:
        found = acted or columns.column_of(names, joints[0], columns.INPUTS[kind])
        if not found:
            raise UsageError(
                f"{path}: which column is the {kind}? Name it with --input. Columns: {', '.join(names)}."
            )
        motions = {joints[0]: motion or columns.column_of(names, joints[0], columns.MOTIONS) or None}
        return motions, {joints[0]: found}, measured
    listed = columns.listed_names(path)

    def every(prefixes: Sequence[str], what: str, option: str) -> dict[str, str]:
        found = columns.columns_of_joints(names, joints, prefixes, listed)
        return columns.require_columns(found, joints, what, names, option)

    positions = every((motion,) if motion else columns.MOTIONS, "positions", "--column")
    inputs = every((acted,) if acted else columns.INPUTS[kind], f"the {kind}", "--input")
    return dict(positions), inputs, measured


def _joints(setup: "Setup", printer: Printer) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the driven joints of a setup, and the other hinges and slides of the model."""
    import mujoco

    model = setup.read().compile()
    acted = {
        int(model.actuator_trnid[i, 0])
        for i in range(model.nu)
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
    }
    single = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    names = {model.joint(i).name: i for i in range(model.njnt) if int(model.jnt_type[i]) in single}
    joints = (setup.joint,)
    if setup.joint == EVERY:
        joints = tuple(name for name, i in names.items() if i in acted or not acted)
        printer.note(f"joints: {', '.join(joints)}")
    return joints, tuple(name for name in names if name and name not in joints)


def _roll(path: Path, column: str | None, acted: str | None, arguments: LogArguments) -> Roll:
    from sysid.logs import read_roll

    options = replace(arguments.options, column=column, also=() if acted is None else (acted,))
    roll = arguments.part(read_roll(path, options))
    if len(roll.time) < 50:
        raise SysidError(
            f"{path}: {len(roll.time)} samples between --from and --to; a driven joint needs 50."
        )
    return roll


def _size(column: str, kind: "InputKind", options: DriveMeasurement, position: Roll) -> float | None:
    """Return one unit of an input in SI; None if neither options nor the name of a hinge's command say it."""
    from sysid.logs.table.names import ANGLE_UNITS, LENGTH_UNITS, parse_column

    unit = options.drive.input_unit
    if isinstance(unit, int | float):
        return unit
    if kind != "command":
        return 1.0
    if unit is None and options.reading.unit is not None:
        return position.unit_size
    named = unit or parse_column(column).unit
    usual = position.unit_size if position.slides else None
    return (ANGLE_UNITS | LENGTH_UNITS).get(named, usual) if named else usual


def _like_position(log: "DrivenLog", zero: float, *, known: bool) -> "DrivenLog":
    """Return a log whose command counts like its position, from its zero [rad or m]; without a known unit in degrees if nearer."""
    command = log.input
    if not known and np.std(command) / np.std(log.angle) > math.sqrt(math.degrees(1.0)):
        command = np.radians(command)
    return replace(log, input=log.angle + _near(command - zero - log.angle, slides=log.slides))


def _near(angle: Any, *, slides: bool) -> Any:
    """Return angles of a hinge [rad], shape (n,), less the whole turns of their middle: reader and controller count them differently."""
    return angle if slides else angle - 2 * np.pi * np.round(np.median(angle) / (2 * np.pi))


def run_driven(
    name: str,
    run: Callable[[Driven, Printer], dict[str, Any]],
    logs: Sequence[Path],
    measurement: DriveMeasurement,
) -> None:
    """Read logs of driven joints, run a command, and write its result to NAME.json."""
    printer = Printer(measurement.common)
    driven = read_driven(logs, measurement, printer)
    for stated in driven.stated.values():
        printer.note(stated.note)
    content = run(driven, printer)
    path = measurement.space.outputs(driven.name) / f"{name}.json"
    write_json(path, content)
    printer.written(path)
    printer.say(f"next: {content['next']}")
    printer.result(content)


def driven_replay(driven: Driven, printer: Printer, tolerance: float, *, gate: bool) -> dict[str, Any]:
    """Replay the inputs in the model and print its error; a gate refuses a model beyond the tolerance."""
    from sim.model.driven import replay

    found: list[dict[str, Any]] = []
    for number in range(len(driven.logs[driven.joints[0]])):
        logs = {joint: driven.logs[joint][number] for joint in driven.joints}
        paths = replay(driven.setup, logs, driven.stated)
        found += [_error(joint, log, log.angle - paths[joint], tolerance) for joint, log in logs.items()]
    rows: list[tuple[str, ...]] = []
    for one in found:
        errors = f"{one['rmse_rad']:.4g}", f"{100 * one['nrmse']:.2f} %", "✓" if one["passed"] else "✗"
        rows.append((one["joint"], Path(one["log"]).name, *errors, one["where"][0]["text"]))
    unit = "m" if driven.logs[driven.joints[0]][0].slides else "rad"
    head = ("joint", "log", f"RMS error [{unit}]", "of the motion", "", "where")
    printer.table(head, rows, "replay of the input in plain MuJoCo")
    passed, worst = all(one["passed"] for one in found), max(found, key=lambda one: one["nrmse"])
    content = {"joints": found, "passed": passed, "nrmse": worst["nrmse"]}
    if passed:
        if gate:
            printer.say(f"passed: NRMSE {100 * worst['nrmse']:.2f} %")
        return {**content, "next": f"the model moves as measured, and is ready to use: {driven.setup.file}"}
    if not gate:
        return {**content, "next": driven.next_step("fit", "measure armature, damping, friction and delay")}
    printer.result(content)
    raise QualityGateError(
        f"joint '{worst['joint']}' has an error of {100 * worst['nrmse']:.2f} % of its motion, {100 * tolerance:.2f} % allowed. "
        "Run diagnose on the same log."
    )


def _error(joint: str, log: "DrivenLog", error: Any, tolerance: float) -> dict[str, Any]:
    """Return the error of a joint's replay and its location."""
    rmse, motion = float(np.sqrt(np.mean(error**2))), float(np.std(log.angle))
    beyond = math.sqrt(max(rmse**2 - log.std**2, 0.0)) / motion
    return {
        "log": log.name,
        "joint": joint,
        "rmse_rad": rmse,
        "nrmse": beyond,
        "noise_floor_rad": log.std,
        "where": _where(log, error),
        "passed": beyond <= tolerance,
        "tolerance": tolerance,
    }


def _where(log: "DrivenLog", error: Any) -> list[dict[str, Any]]:
    """Return the location of the error, by time and by speed: the third with its largest share."""
    rate = np.abs(np.gradient(log.angle, log.time))
    found: list[dict[str, Any]] = []
    for axis, values, unit in (("time", log.time, "s"), ("velocity", rate, "m/s" if log.slides else "rad/s")):
        ends = np.quantile(values, [0, 1 / 3, 2 / 3, 1])
        parts = [error[(values >= a) & (values <= b)] for a, b in pairwise(ends)]
        shares = [float((part**2).sum() / (error**2).sum()) for part in parts]
        i = int(np.argmax(shares))
        text = f"{100 * shares[i]:.0f} % of it at {ends[i]:.3g} to {ends[i + 1]:.3g} {unit}"
        span = [float(ends[i]), float(ends[i + 1])]
        found.append({"axis": axis, "range": span, "share_of_error": shares[i], "text": text})
    return sorted(found, key=lambda one: -one["share_of_error"])


def driven_diagnose(driven: Driven, printer: Printer, fix: Sequence[str]) -> dict[str, Any]:
    """Find the missing effects of each joint; each log of a joint has a process of its own."""
    from sysid.batch.runner import run_all

    fixed = parse_fixed(fix)
    cases = [
        (joint, log, driven.stated[joint], fixed) for joint in driven.joints for log in driven.logs[joint]
    ]
    results: dict[str, Any] = {}
    # Effects of the user's own files are known in this process only.
    here = len(cases) == 1 or printer.common.effect_file
    tried = partial(_diagnosed, told=lambda text: printer.note(f"  tried: {text}"))
    for row in (tried(*case) for case in cases) if here else run_all(_diagnosed, cases, None):
        printer.say(row["text"])
        results.setdefault(row["joint"], []).append(row["verdict"])
    found = [one for own in results.values() for one in own]
    effects = sorted({name for one in found for name in one["verdict"]["effects"]})
    more = [word for name in effects for word in ("--effect", name)]
    why = f"add {' and '.join(effects)} to the model" if effects else "measure what the model has"
    content = found[0] if len(cases) == 1 else {"joints": results}
    return {**content, "next": driven.next_step("fit", why, *more)}


def _diagnosed(
    joint: str,
    log: "DrivenLog",
    stated: "Stated",
    fixed: Mapping[str, float],
    told: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Return the verdict of one log, as JSON and in words."""
    from sysid.driven.diagnose import diagnose
    from sysid.driven.report import verdict_text

    verdict = diagnose(
        log, stated.values, structure=stated.structure, fixed=fixed, simulator=stated.simulator, told=told
    )
    return {"joint": joint, "text": verdict_text(verdict, joint), "verdict": verdict.to_json()}


def driven_fit(
    driven: Driven, printer: Printer, model: "FitArguments", output: Path | None
) -> dict[str, Any]:
    """Fit each joint, print the agreement of its logs, and write a patched copy of the model."""
    from sim.model.driven import patch_driven
    from sim.model.driven_fit import fit_joints
    from sim.model.patch import copy_path
    from sysid.driven.next_motion import next_motion
    from sysid.driven.report import fit_text
    from sysid.driven.runs import agreement
    from sysid.effects import coulomb, delay
    from sysid.fitting.result import TOLERANCE

    if model.prior or model.profile or model.bootstrap:
        raise UsageError(
            "--prior, --profile and --bootstrap are for free swings. A driven joint takes --fix and --bound."
        )
    path = output or copy_path(driven.setup, driven.name, printer.common.space.outputs(driven.name))
    require_writable(path)
    stated = driven.stated
    if model.plain:
        bare = {joint: replace(one.structure, effects=()) for joint, one in stated.items()}
        stated = {joint: replace(one, structure=bare[joint]) for joint, one in stated.items()}
    usual = () if model.plain else (coulomb.EFFECT.name, delay.EFFECT.name)
    fixed, bounds = parse_fixed(model.fix), parse_bounds(model.bound)
    fits = fit_joints(driven.setup, driven.logs, stated, model.effect or usual, fixed=fixed, bounds=bounds)
    merged = {joint: agreement(one) for joint, one in fits.items()}
    for joint, one in merged.items():
        printer.say(fit_text(joint, fits[joint], one, driven.stated[joint].values))
    if all(one.log.held is False for own in fits.values() for one in own):
        driven = driven.smooth()
    motion = model.next_motion
    for joint, one in merged.items():
        if motion is None:
            break
        found = next_motion(one.combined)
        own = motion if len(merged) == 1 else motion.with_stem(f"{motion.stem}_{joint}")
        write_atomically(own, found.csv())
        narrower = f"the interval of {found.worst} becomes {100 * found.narrower:.0f} % as wide"
        printer.say(f"{own}: {found.text}; {narrower}")
    made = patch_driven(driven.setup, {joint: one.combined for joint, one in merged.items()})
    refuse_overwriting([driven.setup.file, *made.files], {"--output": path})
    for line in made.remarks:
        printer.note(line)
    printer.say(made.diff.rstrip())
    printer.written(*made.save(path))
    if max(one.nrmse for own in fits.values() for one in own) > TOLERANCE:
        then = driven.next_step("diagnose", "find the missing effect")
    else:
        why = "replay it in MuJoCo, best on a stretch that the fit did not see"
        then = driven.next_step("check", why, model=path)
    joints = {joint: one.to_json() for joint, one in merged.items()}
    return {"joints": joints, "model": str(path), "next": then}


def driven_export(path: Path, output: Path | None, timestep: float, printer: Printer) -> dict[str, Any]:
    """Write a fit of driven joints as a module for mjlab, and as JSON."""
    from sysid.driven.export import handed_over, mjlab_module

    joints = handed_over(path)
    module = output or path.with_name("actuators.py")
    refuse_overwriting([path], {"--output": module, "JSON beside it": module.with_suffix(".json")})
    write_atomically(module, mjlab_module(joints, timestep=timestep, source=path.name))
    write_json(module.with_suffix(".json"), {"joints": joints})
    printer.written(module, module.with_suffix(".json"))
    return {"joints": joints, "module": str(module)}
