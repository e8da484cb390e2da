"""Do the 95 % intervals of a model's joint hold the truth 95 times in 100?

Three models as strangers write them (tests/support/robots.py) and, where mjlab is installed, the G1's ankle. A truth for each is
let go once by formulas of its own (`sysid.synth`; the loop by MuJoCo's RK4 at a tenth of its step), then measured with fresh noise
for each seed and fitted as `fit --model` does.

python benchmarks/joint_coverage.py --processes 16 --minutes 9 -o joint_coverage.json
"""

import json
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
from pages import table
from scipy.interpolate import CubicSpline
from suite import command_line

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
import robots

from sim.model.scene import scene_of
from sim.model.setup import Setup
from sim.model.subject import board_of
from sysid.board import Board
from sysid.fit_mjcf import fit
from sysid.roll import Array, Release
from sysid.synth import SynthOptions, synthesise
from sysid.synth.sensors import Sensor


@dataclass(frozen=True)
class Case:
    """A joint, what is true of it, and how it is let go."""

    model: str
    joint: str
    truth: Mapping[str, float]
    effects: tuple[str, ...]
    angles: tuple[float, ...]
    rate: float
    duration: float
    noise: float


CASES = {
    "pendulum": Case(
        "arm", "knee", {"damping": 0.035, "coulomb.torque": 0.02, "armature.inertia": 0.002}, ("coulomb", "armature"),
        (0.8, -0.6, 0.5), 250.0, 4.0, 1e-3,
    ),
    "loop": Case("leg", "hip", {"damping": 0.05, "armature.inertia": 0.01}, ("armature",), (0.5, -0.4), 250.0, 4.0, 1e-3),
    "slide": Case(
        "slider", "lift", {"stiffness": 212.0, "damping": 1.1, "rest_angle": 0.028}, (), (0.06, -0.17), 500.0, 4.0, 2e-4
    ),
    "G1 ankle": Case(
        "g1", "left_ankle_roll_joint", {"damping": 6e-4, "coulomb.torque": 1.5e-3, "armature.inertia": 3e-4},
        ("coulomb", "armature"), (0.22, -0.2, 0.17), 500.0, 3.0, 3e-4,
    ),
}  # fmt: skip


def model_of(case: Case) -> Path | None:
    """Return the model's file; None where it is not installed."""
    if case.model != "g1":
        return robots.write(Path(tempfile.mkdtemp()))[case.model]
    found = find_spec("mjlab")
    if found is None or found.origin is None:
        return None
    return Path(found.origin).parent / "asset_zoo/robots/unitree_g1/xmls/g1.xml"


@cache
def ready(name: str) -> tuple[Board, tuple[tuple[Array, Array], ...]] | None:
    """Return the stranger's record and, of each release, time [s] and true position, shape (n,) each."""
    case = CASES[name]
    file = model_of(case)
    if file is None:
        return None
    setup = Setup(file=file, joint=case.joint)
    board, _ = board_of(setup)
    return board, tuple(_path(case, setup, board, angle) for angle in case.angles)


def _path(case: Case, setup: Setup, board: Board, angle: float) -> tuple[Array, Array]:
    grid = np.arange(0.0, case.duration, 1 / case.rate)
    if case.model == "leg":
        scene = scene_of(setup, timestep=1e-4)
        # Its Euler step would miss the inertia by 0.003 %, which is 0.7 standard deviations of this fit.
        scene.model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)
        own = int(scene.model.joint(case.joint).dofadr[0])
        scene.model.dof_damping[own] += case.truth["damping"]
        scene.model.dof_armature[own] += case.truth["armature.inertia"]
        return grid, CubicSpline(*scene.swing(angle, 0.0, case.duration))(grid)
    inertia = board.inertia.value + case.truth.get("armature.inertia", 0.0)
    truth = robots.plain(
        inertia, case.truth.get("stiffness", 0.0), case.truth["damping"], case.truth.get("rest_angle", 0.0)
    )
    pull = {q: value.value for part in board.effects for q, value in part.parameters.items()}
    moment = float(np.hypot(pull["sine"], pull["cosine"]))
    hidden = {"gravity": (moment,)} if moment else {"preload": (pull["constant"],)}
    if "coulomb.torque" in case.truth:
        hidden["coulomb"] = (case.truth["coulomb.torque"],)
    options = SynthOptions(
        angles=(angle,),
        rate=case.rate,
        duration=case.duration,
        hand=False,
        tremor=0.0,
        hold=2.0,
        sensor=Sensor(),
    )
    log = synthesise(truth, hidden, options)
    return np.asarray(log.time), np.asarray(log.channels[:, 0])


def releases_of(name: str, seed: int) -> tuple[Board, list[Release]] | None:
    """Return the stranger's record and its measured releases; None where the model is not installed."""
    case, made = CASES[name], ready(name)
    if made is None:
        return None
    board, paths = made
    rng = np.random.default_rng(seed)
    releases: list[Release] = []
    for number, (instants, true) in enumerate(paths, start=1):
        noisy = true + case.noise * rng.standard_normal(len(true))
        releases.append(
            Release(
                log=f"{name} {seed}", time=instants - instants[0], roll=noisy, std=np.full(len(true), case.noise),
                origin="benchmark", number=number, rest=float(np.mean(noisy[-len(noisy) // 5 :])), hold=1.0, end="rest",
            )
        )  # fmt: skip
    return board, releases


def trial(name: str, seed: int) -> dict[str, tuple[float, bool]] | None:
    """Return error over standard deviation of each parameter, and whether its interval holds the truth."""
    case, made = CASES[name], releases_of(name, seed)
    if made is None:
        return None
    board, releases = made
    found = fit(releases, board, case.effects).quantities
    result: dict[str, tuple[float, bool]] = {}
    for key, value in case.truth.items():
        low, high = found[key].ci95
        result[key] = (found[key].value - value) / found[key].std, low <= value <= high
    return result


def run(
    names: Sequence[str], seeds: int, processes: int, minutes: float
) -> dict[str, dict[str, dict[str, float]]]:
    """Run all trials that fit into the time; return count, coverage and mean error over deviation by case and parameter."""
    until = time.monotonic() + 60 * minutes
    table: dict[str, dict[str, list[tuple[float, bool]]]] = {name: {} for name in names}
    with ProcessPoolExecutor(processes) as pool:
        for start in range(
            0, seeds, processes
        ):  # a bit of each case, so that a short run says something of all
            jobs = [(name, seed) for name in names for seed in range(start, min(start + processes, seeds))]
            for (name, _), result in zip(jobs, pool.map(trial, *zip(*jobs, strict=True)), strict=True):
                for key, value in (result or {}).items():
                    table[name].setdefault(key, []).append(value)
            if time.monotonic() > until:
                break
    return {
        name: {
            key: {
                "trials": len(rows), "coverage": float(np.mean([hit for _, hit in rows])),
                "bias_in_std": float(np.mean([error for error, _ in rows])),
            }
            for key, rows in keys.items()
        }
        for name, keys in table.items()
    }  # fmt: skip


def main() -> None:
    """Print the table, and write it where it is asked for."""
    parser = command_line(__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--case", action="append", choices=list(CASES))
    parser.add_argument("-o", "--output", type=Path)
    arguments = parser.parse_args()
    result = run(arguments.case or list(CASES), arguments.seeds, arguments.processes, arguments.minutes)
    rows = [
        (name, key, f"{row['trials']}", f"{100 * row['coverage']:.1f} %", f"{row['bias_in_std']:+.2f}")
        for name, keys in result.items()
        for key, row in keys.items()
    ]
    print(table(("joint", "parameter", "trials", "inside 95 %", "mean error / std"), rows))
    if arguments.output:
        arguments.output.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
