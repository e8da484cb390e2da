"""How the right foot creeps along the deck in long rides: in which phase of the cycle, and how much of it is MuJoCo's contact.

Run `python benchmarks/foot_creep.py [--episodes 8] [--workers 16] [--policies data/policies/pink.onnx …]`. Every ride is told
the same twice: on the scene's own contacts, whose pyramidal friction gives way a little under any load, and on elliptic cones ten
times as stiff along the ground as across it (`impratio`; MuJoCo's manual, "Preventing slip"). No policy was trained on these.
"""

import argparse
import os
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
from pages import table, write_result

from policy_runtime.evaluation.plain import Protocol, policy_named, protocol_world, riders, run_episode
from policy_runtime.evaluation.recording import Recording
from policy_runtime.evaluation.result import TIME_LIMIT
from policy_runtime.evaluation.statistics import mean_over
from sim.skate.cycle.clock import STILL_SPEED, Clock
from sim.skate.robot.g1 import FOOT_BODIES
from sim.skate.world.scene import BOARD, ROBOT
from sysid.roll import Array
from sysid.workspace import Workspace

ROOT = Path(__file__).parents[1]
DURATION = 300.0
"""[s]"""
STIFFER = 10.0
"""Ratio of frictional to normal impedance of the stiffer contacts [1]."""
PHASES = ("pushing", "mounting", "steering", "dismounting")
Ride = tuple[float, bool, list[float]]
"""How long it was [s], whether it lasted, and by how much the foot crept ahead in each phase of a cycle [m]."""


def ride(policy: Path, stiffer: bool, episode: int) -> Ride | None:
    """Ride one episode; None where it is told to stand."""
    board = Workspace(Path("/nonexistent")).load_board("black" if policy.stem.startswith("black") else "pink")
    protocol = Protocol(duration=DURATION)
    world = protocol_world(board, protocol)
    model = world.robot.model
    if stiffer:
        model.opt.cone, model.opt.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, STIFFER
    recording, ending = run_episode(
        world, policy_named(str(policy), board, force=True), protocol, np.random.default_rng([0, episode])
    )
    if recording.column("command")[0, 0] < STILL_SPEED:
        return None
    return float(recording.column("time")[-1]), ending == TIME_LIMIT, _creep(model, recording)


def _creep(model: mujoco.MjModel, recording: Recording) -> list[float]:
    """Return by how much the foot creeps in each phase of a cycle [m]."""
    moved, clock = np.diff(foot_place(model, recording.column("qpos"))), Clock()
    step = recording.column("step")[:-1]
    cycles = len(step) / clock.period
    return [float(moved[getattr(clock, name)(step)].sum() / cycles) for name in PHASES]


def foot_place(model: mujoco.MjModel, qpos: Array) -> Array:
    """Return where the right foot is along the deck [m], (t,), from the scene's configurations, (t, nq)."""
    data = mujoco.MjData(model)
    deck, foot = model.body(f"{BOARD}deck").id, model.body(ROBOT + FOOT_BODIES[1]).id
    places: list[float] = []
    for configuration in qpos:
        data.qpos[:] = configuration
        mujoco.mj_kinematics(model, data)
        places.append((data.xpos[foot] - data.xpos[deck]) @ data.xmat[deck].reshape(3, 3)[:, 0])
    return np.array(places)


def main() -> None:
    """Ride, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    shipped = [ROOT / "data" / "policies" / f"{name}.onnx" for name in ("pink", "black")]
    parser.add_argument("--policies", type=Path, nargs="*", default=shipped)
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    options = parser.parse_args()
    rows: list[tuple[str, ...]] = []
    with riders(options.workers) as pool:
        for policy in options.policies:
            for stiffer in (False, True):
                work = partial(ride, policy, stiffer)
                rides = (map if pool is None else pool.map)(work, range(options.episodes))
                rode = [found for found in rides if found is not None]
                lengths, lasted, crept = (np.array(column) for column in zip(*rode, strict=True))
                # A ride is one sample: its cycles are told the same speed.
                whole = mean_over([1e3 * crept.sum(1)], "mm")
                rows.append(
                    (
                        policy.stem,
                        "elliptic, stiffer" if stiffer else "as trained",
                        f"{lasted.sum()} of {len(rode)}",
                        f"{lengths.mean():.0f}",
                        f"{whole.value:+.1f} [{whole.ci95[0]:+.1f}, {whole.ci95[1]:+.1f}]",
                        *(f"{1e3 * size:+.1f}" for size in crept.mean(0)),
                    )
                )
    head = ("policy", "contacts", "last", "mean length [s]", "creep a cycle [mm]", *PHASES)
    note = (
        f"Rides of {DURATION:.0f} s on level ground, {options.episodes} episodes of seed 0 a policy without those told to "
        "stand. Creep is along the deck, ahead positive, mean over the rides, and by phase of the cycle of 6 s."
    )
    write_result("foot_creep.md", "\n\n".join(("# How the right foot creeps", note, table(head, rows))))


if __name__ == "__main__":
    main()
