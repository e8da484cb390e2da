"""Public benchmarks of driven joints, and planted parameters found again. Data are the reader's own: nothing is fetched.

python benchmarks/driven_public.py silverbox SNLS80mV.csv
python benchmarks/driven_public.py emps DATA_EMPS.mat
python benchmarks/driven_public.py leg --draws 200 --workers 2
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from suite import run_suite

from sysid.driven.fit import fit, free_of
from sysid.driven.joint import Structure
from sysid.driven.log import DrivenLog, Load
from sysid.driven.problem import Problem
from sysid.effects import asymmetric_stiffness, coulomb, cubic_stiffness, delay, servo_gains, torque_constant

SILVERBOX_RATE = 1e7 / 2**14
"""Sampling of Silverbox [Hz]."""


def silverbox(path: Path) -> None:
    """Fit 8,192 samples of the multisine; simulate the arrow."""
    table = np.genfromtxt(path, delimiter=",", skip_header=1)[:, :2]

    def part(first: int, last: int) -> DrivenLog:
        time = np.arange(last - first) / SILVERBOX_RATE
        return DrivenLog(name="silverbox", time=time, angle=table[first:last, 1], std=2e-4, input=table[first:last, 0], kind="torque",
                         load=Load.constant(1.0, last - first), held=False)  # fmt: skip

    effects = (cubic_stiffness.EFFECT.name, asymmetric_stiffness.EFFECT.name)
    structure, natural = Structure("torque", effects), (2 * np.pi * 70) ** 2
    gain = f"{torque_constant.EFFECT.name}.gain"
    free = (
        "stiffness",
        *(
            name
            for name in free_of(structure, (*effects, torque_constant.EFFECT.name), {})
            if name != "armature"
        ),
    )
    train = part(40_650, 40_650 + 8192)
    found = fit(train, structure, {"stiffness": natural, "damping": 20.0, gain: natural}, free)
    arrow = part(100, 40_575)
    problem = Problem(log=arrow, structure=structure, values=found.values, free=free, substeps=8)
    error = 1e3 * problem.residuals(problem.begin(), slopes=False)[0][0] * arrow.std
    inside = int(np.argmax(np.abs(arrow.angle) > np.abs(train.angle).max()))
    print(
        f"whole arrow {np.sqrt(np.mean(error**2)):.3f} mV, within the training amplitude {np.sqrt(np.mean(error[:inside] ** 2)):.3f} mV"
    )


def emps(path: Path) -> None:
    """Fit mass, viscous and dry friction and offset of the positioning system."""
    from scipy.io import loadmat

    data = loadmat(path)
    time, angle = data["t"].ravel(), data["qm"].ravel()
    force = data["vir"].ravel() * float(data["gtau"].ravel()[0])
    log = DrivenLog(
        name="emps",
        time=time,
        angle=angle,
        std=2e-6,
        input=force,
        kind="force",
        load=Load.constant(0.0, len(time)),
    )
    structure = Structure("force", (coulomb.EFFECT.name,))
    found = fit(log, structure, {}, free_of(structure, structure.effects, {}))
    for (name, quantity), author in zip(
        found.quantities.items(), (95.1089, 203.5034, 3.1648, 20.3935), strict=True
    ):
        print(f"{name:16} {quantity}; the authors' {author} ({100 * (quantity.value / author - 1):+.1f} %)")
    print(f"error of the whole simulation {100 * found.rmse / angle.std():.2f} % of the motion")


def leg(seed: int) -> dict[str, Any]:
    """Return whether each planted parameter of one joint of a leg is inside its 95 % interval."""
    rng = np.random.default_rng(seed)
    truth = {
        "armature": rng.uniform(0.02, 0.12), "damping": rng.uniform(0.5, 4.0), "friction": rng.uniform(0.2, 1.5),
        "zero": rng.uniform(-0.06, 0.06), "delay": 5e-4 * rng.integers(4, 24),
    }  # fmt: skip
    kp, kd, mass, arm, rate, step = 80.0, 2.0, rng.uniform(1.5, 3.5), rng.uniform(0.12, 0.25), 400.0, 5e-4
    own = mass * 0.004
    spec = mujoco.MjSpec.from_string(
        f"""<mujoco><option timestep="{step}" integrator="RK4"/><worldbody><body><joint name="j" axis="0 1 0"
        armature="{truth["armature"]}" damping="{truth["damping"]}" frictionloss="{truth["friction"]}" solreffriction="0.002 1"
        solimpfriction="0.9999 0.9999 0.001"/><inertial pos="0 0 -{arm}" mass="{mass}" diaginertia="{own} {own} {own}"/></body></worldbody>
        <actuator><position joint="j" kp="{kp}" kv="{kd}"/></actuator></mujoco>"""
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    t = np.arange(int(10 * rate)) / rate
    chirp = 2 * np.pi * (0.1 * t + 4.9 * t**2 / 20)
    command = 0.5 * np.sin(chirp) * np.minimum(1, t)
    late, every = round(truth["delay"] / step), round(1 / rate / step)
    angle = np.empty_like(t)
    for i in range(len(t) * every):
        if i % every == 0:
            angle[i // every] = data.qpos[0]
        # The encoder reads the joint's angle plus its zero, and the servo follows the encoder.
        data.ctrl[0] = command[max(0, i - late) // every] - truth["zero"]
        mujoco.mj_step(model, data)
    seen = angle + truth["zero"] + 3e-4 * rng.standard_normal(len(t))
    weight = mass * 9.81 * arm

    def load(zero: float) -> Load:
        inertia = np.full(len(t), own + mass * arm**2)
        return Load(
            inertia=inertia,
            torque=-weight * np.sin(seen - zero),
            slope=-weight * np.cos(seen - zero),
            zero=zero,
        )

    log = DrivenLog(
        name=f"leg {seed}", time=t, angle=seen, std=3e-4, input=command, kind="command", load=load(0.0)
    )
    structure = Structure("command", (coulomb.EFFECT.name, delay.EFFECT.name))
    gains = {f"{servo_gains.EFFECT.name}.kp": kp, f"{servo_gains.EFFECT.name}.kd": kd}
    free = free_of(structure, structure.effects, {"bias": 0.0}, more=("zero",))
    found = fit(log, structure, gains, free, quick=True)
    found = fit(replace(log, load=load(found.values["zero"])), structure, gains, free, begins=[found.values])
    names = {"friction": f"{coulomb.EFFECT.name}.torque", "delay": f"{delay.EFFECT.name}.time"}
    row: dict[str, Any] = {"seed": seed, "error": found.rmse / log.std}
    for name, value in truth.items():
        quantity = found.quantities[names.get(name, name)]
        low, high = quantity.ci95
        row[name] = bool(low <= value <= high)
        row[f"{name} off"] = (quantity.value - value) / value
    return row


def main() -> None:
    """Run one benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("which", choices=("silverbox", "emps", "leg"))
    parser.add_argument("file", type=Path, nargs="?")
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--rows", type=Path)
    options = parser.parse_args()
    if options.which != "leg":
        (silverbox if options.which == "silverbox" else emps)(options.file)
        return
    rows = run_suite(
        leg, [(seed,) for seed in range(options.draws)], ("seed",), options.rows, workers=options.workers
    )
    for name in ("armature", "damping", "friction", "zero", "delay"):
        off = float(np.median([abs(row[f"{name} off"]) for row in rows]))
        print(
            f"{name:9} inside in {sum(row[name] for row in rows)} of {len(rows)}; off by {100 * off:.2f} % in the median"
        )


if __name__ == "__main__":
    main()
