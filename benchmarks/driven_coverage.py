"""Coverage of the 95 % intervals of driven joints: parameters planted in plain MuJoCo.

Run `python benchmarks/driven_coverage.py --draws 200 --workers 2 --rows coverage.jsonl`.
There are three joints: one under a torque, a double pendulum under torques, a leg of two position servos (PACE, Bjelonic et al. 2025).
Half of the draws are nature: RK4 at 50 µs, friction that turns within a step. The others are MuJoCo with its own friction:
Euler, implicitfast or RK4 at 1 or 2 ms. The fit knows the masses and nothing of the draw.
"""

import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from pages import table, write_between
from suite import command_line, run_suite

from sim.model.driven import Course, load_along, stated
from sim.model.driven_fit import fit_joints
from sim.model.setup import Setup
from sysid.driven.log import DrivenLog
from sysid.effects import coulomb, delay
from sysid.quantity import Z95

PAGE = Path(__file__).with_name("public.md")
CASES = ("single", "double", "servo")
RATE, SECONDS, NOISE = 250, 10.0, 3e-4
"""Samples a second, length [s], noise of the encoders [rad]."""
NATURE = ("RK4", 5e-5, 'solreffriction="0 -500000" solimpfriction="0.9999 0.9999 0.001"')
SIMULATORS = (("Euler", 2e-3, ""), ("implicitfast", 1e-3, ""), ("RK4", 1e-3, ""))
"""Integrator, step [s], and friction constraint."""
GAINS = (85.0, 0.6)
"""kp and kd of the servos [N·m/rad, N·m·s/rad]."""
NAMES = {"friction": f"{coulomb.EFFECT.name}.torque", "delay": f"{delay.EFFECT.name}.time"}


def xml(links: list[tuple[float, float]], attributes: list[str], option: str, *, servo: bool) -> str:
    """Return a chain of links (mass [kg], length [m]) under motors or servos, each joint with its attributes."""
    body = ""
    for i, ((mass, length), own) in reversed(list(enumerate(zip(links, attributes, strict=True)))):
        inertia = mass * length**2 / 12
        body = f"""<body pos="0 0 {-links[i - 1][1] if i else 0}"><joint name="j{i}" axis="0 1 0" {own}/>
            <inertial pos="0 0 {-length / 2}" mass="{mass}" diaginertia="{inertia} {inertia} {inertia / 50}"/>{body}</body>"""
    kind = f'position kp="{GAINS[0]}" kv="{GAINS[1]}"' if servo else "motor"
    acting = "".join(f'<{kind} name="a{i}" joint="j{i}"/>' for i in range(len(links)))
    return f"<mujoco>{option}<worldbody>{body}</worldbody><actuator>{acting}</actuator></mujoco>"


@dataclass(frozen=True)
class Draw:
    """Planted joints and their log."""

    servo: bool
    law: str
    truth: list[dict[str, float]]
    """Planted values of each joint."""
    model: str
    """MJCF of the user: right masses, no friction and next to no armature."""
    time: np.ndarray
    inputs: np.ndarray
    """Torque [N·m] or command [rad], shape (joints, n)."""
    seen: np.ndarray
    """Angles that the encoders read [rad], shape (joints, n)."""


def draw(case: str, seed: int, *, late: bool = True) -> Draw:
    """Return a draw; without `late` delay, bias and zero are 0."""
    rng = np.random.default_rng([seed, CASES.index(case)])
    servo, joints = case == "servo", 1 if case == "single" else 2
    integrator, step, constraint = NATURE if seed % 2 == 0 else SIMULATORS[seed // 2 % len(SIMULATORS)]
    size = 2.0 if servo else 1.0
    links = [(size * rng.uniform(0.5, 1.5), rng.uniform(0.2, 0.35)) for _ in range(joints)]
    truth = [
        {"armature": rng.uniform(0.02, 0.12) if servo else rng.uniform(0.005, 0.03),
         "damping": rng.uniform(0.5, 3.0) if servo else rng.uniform(0.1, 0.4),
         "friction": rng.uniform(0.2, 1.5) if servo else rng.uniform(0.03, 0.2),
         ("zero" if servo else "bias"): late * rng.uniform(-0.06, 0.06), "delay": late * 2e-3 * rng.integers(1, 8)}
        for _ in links
    ]  # fmt: skip
    own = [
        f'armature="{p["armature"]}" damping="{p["damping"]}" frictionloss="{p["friction"]}" {constraint}'
        for p in truth
    ]
    model = mujoco.MjModel.from_xml_string(
        xml(links, own, f'<option timestep="{step}" integrator="{integrator}"/>', servo=servo)
    )
    time, inputs = waves(rng, joints)
    inputs *= 0.5 if servo else 1.5 * np.array([[m * 9.81 * x / 2] for m, x in links])
    angle = moved(model, inputs, [p["delay"] for p in truth], [p.get("bias", 0.0) for p in truth],
                  [p.get("zero", 0.0) for p in truth])  # fmt: skip
    asked, name = (step, integrator) if seed % 2 else SIMULATORS[0][1::-1]
    option = f'<option timestep="{asked}" integrator="{name}"/>'
    return Draw(
        servo, integrator if seed % 2 else "nature", truth, xml(links, ['armature="0.001"'] * joints, option, servo=servo),
        time, inputs, angle + NOISE * rng.standard_normal(angle.shape),
    )  # fmt: skip


def run(case: str, seed: int) -> dict[str, Any]:
    """Return how many deviations each planted parameter is off."""
    one = draw(case, seed)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.xml"
        file.write_text(one.model)
        fits = list(fitted(Setup(file=file, joint="j0"), one).values())
    row: dict[str, Any] = {"case": case, "seed": seed, "law": one.law}
    row["error"] = max(fit.rmse for fit in fits) / NOISE
    row["simulator"] = [fit.structure.simulator is not None for fit in fits]
    for name in one.truth[0]:
        found = [fit.quantities[NAMES.get(name, name)] for fit in fits]
        planted = [values[name] for values in one.truth]
        row[name] = [float((q.value - x) / q.std) for q, x in zip(found, planted, strict=True)]
        row[f"{name} off"] = [float(q.value / x - 1) for q, x in zip(found, planted, strict=True)]
    return row


def waves(rng: np.random.Generator, joints: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s], shape (n,), and sums of sines of 0.1 to 5 Hz within ±1, shape (joints, n)."""
    time = np.arange(int(SECONDS * RATE)) / RATE
    parts = [
        [f**-0.5 * np.sin(2 * np.pi * f * time + rng.uniform(0, 7)) for f in rng.uniform(0.8, 1.2) * np.geomspace(0.1, 5, 9)]
        for _ in range(joints)
    ]  # fmt: skip
    found = np.sum(parts, axis=1) * np.minimum(1, 2 * time)
    return time, found / np.abs(found).max(axis=1, keepdims=True)


def moved(model: Any, inputs: np.ndarray, delays: Any, bias: Any, zero: Any) -> np.ndarray:
    """Return what encoders read of a model under inputs that are late and held, shape (joints, n) [rad]."""
    data, step = mujoco.MjData(model), float(model.opt.timestep)
    every = round(1 / RATE / step)
    late = [round(one / step) for one in delays]
    ends = sorted({0, every, *(one % every for one in late)})
    seen = np.empty_like(inputs)
    servo = model.actuator_biastype[0] != mujoco.mjtBias.mjBIAS_NONE
    for i in range(inputs.shape[1]):
        seen[:, i] = data.qpos + zero
        for begin, end in pairwise(ends):
            for j, one in enumerate(late):
                value = inputs[j, max(0, i * every + begin - one) // every]
                data.ctrl[j] = value - zero[j] if servo else value + bias[j]
            mujoco.mj_step(model, data, end - begin)
    return seen


def fitted(
    setup: Setup, one: Draw, *, more: tuple[str, ...] = tuple(NAMES.values()), rows: int | None = None
) -> dict[str, Any]:
    """Return the fit of each joint to the first samples of a draw."""
    kind = "command" if one.servo else "torque"
    time, seen, inputs = one.time[:rows], one.seen[:, :rows], one.inputs[:, :rows]
    setups = {f"j{i}": setup.with_(joint=f"j{i}") for i in range(len(seen))}
    courses = {name: Course.measured(time, angle) for name, angle in zip(setups, seen, strict=True)}
    logs = {
        name: [DrivenLog(name="log", time=time, angle=courses[name].angle, std=NOISE, input=u, kind=kind, load=load_along(own, courses))]
        for (name, own), u in zip(setups.items(), inputs, strict=True)
    }  # fmt: skip
    known = {name: stated(own, kind) for name, own in setups.items()}
    zero: dict[str, Any] = {"fixed": {"bias": 0.0}, "bounds": {"zero": (-0.3, 0.3)}} if one.servo else {}
    effects = [name.split(".")[0] for name in more]
    return {name: fits[0] for name, fits in fit_joints(setup, logs, known, effects, **zero).items()}


def main() -> None:
    """Run the draws, and write the table."""
    parser = command_line(__doc__)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rows", type=Path, help="JSON lines of an earlier run to go on from")
    parser.add_argument("--seconds", type=float, default=float("inf"))
    options = parser.parse_args()
    cases = [(case, seed) for seed in range(options.draws) for case in CASES]
    rows = run_suite(
        run, cases, ("case", "seed"), options.rows, workers=options.workers, seconds=options.seconds
    )
    write_between(PAGE, "coverage of driven joints", page(rows))


def page(rows: list[dict[str, Any]]) -> str:
    """Return the table of rows, and their sum."""
    lines: list[tuple[str, ...]] = []
    every: list[float] = []
    for case in CASES:
        own = [row for row in rows if row["case"] == case]
        for name in ("armature", "damping", "friction", "bias", "zero", "delay"):
            off = np.array([z for row in own for z in row.get(name, ())])
            if not len(off):
                continue
            every += [*off]
            relative = np.median(np.abs([x for row in own for x in row[f"{name} off"]]))
            laws = [
                [z for row in own if (row["law"] == "nature") is nature for z in row[name]]
                for nature in (True, False)
            ]
            lines.append(
                (case, str(len(own)), name, *(share(one) for one in (*laws, off)), f"{100 * relative:.2g} %")
            )
    head = ("joints", "draws", "parameter", "nature", "MuJoCo", "both", "error, median")
    wrong = sum(any(found is (row["law"] == "nature") for found in row["simulator"]) for row in rows)
    return f"{table(head, lines)}\n\nIn all {share(every)}. The law, nature or MuJoCo, was wrong in {wrong} of {len(rows)} draws."


def share(off: Any) -> str:
    """Return how many of deviations are inside 95 % intervals."""
    inside = int((np.abs(off) < Z95).sum())
    return f"{inside} of {len(off)}, {100 * inside / len(off):.1f} %"


if __name__ == "__main__":
    main()
