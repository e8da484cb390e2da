"""The same joints of MuJoCo models, asked of mujoco.sysid and of this tool: lines to write, seconds, error, what is missing.

Run:  pip install "mujoco[sysid]" && python benchmarks/joint_peers.py [SEEDS]

Models, truths and noise are those of `joint_coverage.py`, sampled at the model's own step, so that neither has to interpolate.
Both begin at what the model states. mujoco.sysid cannot fit how a release begins: it is given the first sample at rest, and of
the loop the pose that closes it. Its friction is given solver parameters under which MuJoCo's frictionloss is dry friction. Lines
are those that a user writes: of its program the body of `identify` below, of ours the commands. Then both are asked what is
missing where one part of the truth is left out of what is fitted.
"""

import contextlib
import inspect
import io
import logging
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import joint_coverage as joints
import mujoco
import numpy as np
from pages import table, write_result

from sim.model.scene import scene_of
from sim.model.setup import Setup
from sysid import diagnose
from sysid.fit_mjcf import fit
from sysid.roll import Array

USUAL = 0.02
"""Inertia of a joint for which the bounds below are wide [kg*m^2]; those of a smaller one shrink with it."""
BOUNDS = {
    "stiffness": (50.0, 1000.0), "damping": (1e-6, 5.0), "rest_angle": (-0.1, 0.1), "coulomb.torque": (1e-6, 0.5),
    "armature.inertia": (1e-7, 0.1),
}  # fmt: skip
LEFT_OUT = {
    "pendulum": "armature.inertia",
    "loop": "armature.inertia",
    "slide": "",
    "G1 ankle": "coulomb.torque",
}
OURS = 1
"""Lines of ours: `husky-sysid fit LOG --model robot.xml --joint knee --effect coulomb --effect armature`."""


@dataclass(frozen=True)
class Answer:
    """What one of them found."""

    seconds: float
    errors: dict[str, float]
    """Of each parameter, over its true value."""
    held: dict[str, bool]
    """Whether its 95 % interval holds the truth."""
    says: str = ""


def identify(
    file: Path,
    joint: str,
    keep: set[str],
    logs: list[tuple[Array, Array]],
    starts: list[Array],
    names: list[str],
    bounds: dict[str, tuple[float, float]],
) -> tuple[Array, Array, str]:
    """Return values, half-widths of their 95 % intervals and insights of mujoco.sysid: what a user of it writes."""
    from mujoco import sysid
    from mujoco.sysid.report.sections.insights import AutomatedInsights

    spec = mujoco.MjSpec.from_file(str(file))
    for thing in (*spec.keys, *spec.actuators, *spec.sensors):
        spec.delete(thing)
    for other in list(spec.joints):
        if other.name not in keep:
            spec.delete(other)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    spec.joint(joint).solref_friction[:] = 0.002, 1.0
    spec.joint(joint).solimp_friction[:3] = 0.9999, 0.9999, 0.001
    model = spec.compile()
    stated = spec.joint(joint)
    begins = {
        "stiffness": float(stated.stiffness[0]), "damping": float(stated.damping[0]), "rest_angle": float(stated.springref),
        "coulomb.torque": float(stated.frictionloss), "armature.inertia": float(stated.armature),
    }  # fmt: skip

    def set_stiffness(target: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
        target.joint(joint).stiffness[0] = parameter.value[0]

    def set_damping(target: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
        target.joint(joint).damping[0] = parameter.value[0]

    def set_rest(target: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
        target.joint(joint).springref = parameter.value[0]

    def set_friction(target: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
        target.joint(joint).frictionloss = parameter.value[0]

    def set_armature(target: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
        target.joint(joint).armature = parameter.value[0]

    setters = dict(
        zip(begins, (set_stiffness, set_damping, set_rest, set_friction, set_armature), strict=True)
    )
    parameters = sysid.ParameterDict()
    for name in names:
        low, high = bounds[name]
        begin = min(max(begins[name], low + 0.01 * (high - low)), high)
        parameters.add(sysid.Parameter(name, begin, low, high, modifier=setters[name]))
    channel = (f"{joint}_qpos", sysid.SignalType.MjStateQPos)
    sequences = []
    for number, ((instants, measured), start) in enumerate(zip(logs, starts, strict=True)):
        sensed = sysid.TimeSeries.from_names(instants, measured[:, None], model, names=[channel])
        begin = sysid.create_initial_state(model, start, np.zeros(model.nv))
        still = sysid.TimeSeries(instants, np.zeros((len(instants), 0)))
        sequences.append(
            sysid.ModelSequences(
                "joint", spec, f"release{number}", begin, still, sensed, allow_missing_sensors=True
            )
        )
    residual = sysid.build_residual_fn(models_sequences=sequences, enabled_observations=[channel])
    found, result = sysid.optimize(parameters, residual, optimizer="scipy", verbose=False)
    residuals = residual(found.as_vector(), found)[0]
    _, intervals = sysid.calculate_intervals(residuals, result.jac)
    insights = "; ".join(insight["title"] for insight in AutomatedInsights("Log", found)._insights)
    return found.as_vector(), np.asarray(intervals), insights


def theirs(name: str, seed: int, *, without: str = "") -> Answer:
    """Ask mujoco.sysid."""
    case, made = joints.CASES[name], joints.releases_of(name, seed)
    assert made is not None
    file = joints.model_of(case)
    assert file is not None
    scene = scene_of(Setup(file=file, joint=case.joint))
    data = mujoco.MjData(scene.model)
    keep = {case.joint} if name != "loop" else {"hip", "knee", "crank"}
    where = [
        int(scene.model.jnt_qposadr[scene.model.joint(joint).id]) for joint in scene_order(scene.model, keep)
    ]
    logs, starts = [], []
    # These logs count from where the joint hangs, which ours finds; mujoco.sysid is told.
    hangs = made[0].rest_angle if name in ("pendulum", "G1 ankle") else 0.0
    for release in made[1]:
        scene.begin(scene.model, data, float(release.roll[0]) + hangs, 0.0)
        logs.append((release.time, release.roll + hangs))
        starts.append(data.qpos[where].copy())
    names = [key for key in case.truth if key != without]
    size = min(1.0, made[0].inertia.value / USUAL)
    bounds = {key: (size * low, size * high) for key, (low, high) in BOUNDS.items()}
    begin = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):
        values, half, says = identify(file, case.joint, keep, logs, starts, names, bounds)
    seconds = time.perf_counter() - begin
    # The truth's armature is what the model lacks; its own is fitted here.
    own = mujoco.MjSpec.from_file(str(file)).joint(case.joint).armature
    values = values - [own if key == "armature.inertia" else 0.0 for key in names]
    truth = np.array([case.truth[key] for key in names])
    return Answer(
        seconds, dict(zip(names, np.abs(values - truth) / np.abs(truth), strict=True)),
        dict(zip(names, np.abs(values - truth) < half, strict=True)), says,
    )  # fmt: skip


def scene_order(model: mujoco.MjModel, keep: set[str]) -> list[str]:
    """Return the joints that are kept, in the order of the model."""
    return [name for name in (model.joint(i).name for i in range(model.njnt)) if name in keep]


def ours(name: str, seed: int, *, without: str = "") -> Answer:
    """Ask this tool."""
    case, made = joints.CASES[name], joints.releases_of(name, seed)
    assert made is not None
    board, releases = made
    effects = [effect for effect in case.effects if not without.startswith(effect)]
    begin = time.perf_counter()
    found = fit(releases, board, effects)
    seconds = time.perf_counter() - begin
    shown = {key: found.quantities[key] for key in case.truth if key != without}
    says = ""
    if without or not case.effects:
        told = diagnose(releases, found.board).verdict
        says = f"{told.status}: {' + '.join(told.effects)}" if told.effects else told.status
    return Answer(
        seconds,
        {key: abs(q.value - case.truth[key]) / abs(case.truth[key]) for key, q in shown.items()},
        {key: q.ci95[0] <= case.truth[key] <= q.ci95[1] for key, q in shown.items()},
        says,
    )


def row(name: str, tool: str, lines: int, answers: list[Answer], says: str) -> tuple[str, ...]:
    """Return a row of the table: medians over the seeds."""
    keys = answers[0].errors
    errors = ", ".join(
        f"{key.split('.')[0]} {100 * median(a.errors[key] for a in answers):.2g} %" for key in keys
    )
    held = sum(held for answer in answers for held in answer.held.values())
    seconds = f"{median(a.seconds for a in answers):.2g}"
    return name, tool, f"{lines}", seconds, errors, f"{held} of {len(answers) * len(keys)}", says


def main() -> None:
    """Write the table."""
    logging.disable(logging.WARNING)
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    body = inspect.getsource(identify).split('"""')[2]
    lines = sum(bool(line.strip()) and not line.strip().startswith("#") for line in body.splitlines())
    rows: list[tuple[str, ...]] = []
    for name, case in joints.CASES.items():
        file = joints.model_of(case)
        if file is None:
            continue
        step = mujoco.MjSpec.from_file(str(file)).option.timestep
        joints.CASES[name] = replace(case, rate=1.0 / step)
        for tool, ask, count in (("mujoco.sysid", theirs, lines), ("husky-sysid", ours, OURS)):
            answers = [ask(name, seed) for seed in range(seeds)]
            says = ask(name, 0, without=LEFT_OUT[name]).says
            rows.append(row(name, tool, count, answers, says))
            print(*rows[-1], sep=" | ", flush=True)
    left = "; ".join(f"{name}: {part.split('.')[0] or 'nothing'}" for name, part in LEFT_OUT.items())
    head = (
        "joint", "tool", "lines to write", "seconds", "error", "95 % intervals that hold the truth",
        "says is missing, one part left out",
    )  # fmt: skip
    write_result(
        "joint_peers.md",
        "# Joints of MuJoCo models, beside mujoco.sysid\n\n"
        f"Made by `benchmarks/joint_peers.py`; MuJoCo {mujoco.__version__}, medians of {seeds} seeds.\n\n"
        f"{table(head, rows)}\n\nLeft out: {left}.",
    )


if __name__ == "__main__":
    main()
