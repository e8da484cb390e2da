"""How policies cross ledges: from the suite's rides on them, every crossing by height, speed, angle and phase of the cycle.

Run `python benchmarks/ledge_crossings.py [--episodes 40] [--workers 16] [--policies data/policies/pink.onnx …]`. A crossing
is a front axle that passes an edge; it ends the ride if that ends within 3 s. Who has turned back towards the start
rides against a ledge, which nobody can climb: such ends are counted apart.
"""

import argparse
import math
import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from pages import table, write_result

from policy_runtime.evaluation.plain import Protocol, policy_named, protocol_world, riders, run_episode
from policy_runtime.evaluation.recording import Recording
from policy_runtime.evaluation.result import TIME_LIMIT
from policy_runtime.evaluation.statistics import proportion
from sim.skate.arrays import wrap_angle
from sim.skate.cycle.clock import STILL_SPEED, Clock
from sim.skate.world.terrain import STEP_LENGTH, STEPS
from sysid.text import in_brackets as text
from sysid.workspace import Workspace

ROOT = Path(__file__).parents[1]
FATAL = 3.0
"""A ride that ends so soon after a crossing ended by it [s]."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """A board that rolled over an edge."""

    height: float
    """[m]"""
    speed: float
    """[m/s]"""
    askew: float
    """Angle between the board and the way down [rad]."""
    phase: str
    fatal: bool


def crossings(recording: Recording, wheelbase: float, ended: bool) -> list[Crossing]:
    """Return every crossing of a ride."""
    heading, speed = recording.column("board_heading"), recording.column("board_speed")
    axle = recording.column("board_position")[:, :2] + wheelbase / 2 * ahead(heading)
    clock = Clock()
    found: list[Crossing] = []
    for number, height in enumerate(STEPS, start=1):
        passed = np.flatnonzero(np.abs(axle).max(-1) > number * STEP_LENGTH)
        if not len(passed):
            break
        at, step = passed[0], int(recording.column("step")[passed[0]])
        phase = next(
            name for name in ("pushing", "mounting", "steering", "dismounting") if getattr(clock, name)(step)
        )
        fatal = ended and float(recording.column("time")[-1] - recording.column("time")[at]) < FATAL
        askew = abs(float(wrap_angle(heading[at] - down(axle[at]))))
        found.append(Crossing(height, float(speed[at]), askew, phase, fatal))
    return found


def ahead(heading: np.ndarray) -> np.ndarray:
    """Return the unit vectors of headings, (n, 2)."""
    return np.stack((np.cos(heading), np.sin(heading)), axis=-1)


def down(place: np.ndarray) -> float:
    """Return which way the ledge nearest to a place goes down [rad]: one of the four sides of the squares."""
    x, y = place
    return math.atan2(0.0, x) if abs(x) >= abs(y) else math.copysign(math.pi / 2, y)


def cross(policy: Path, episode: int) -> tuple[str, list[Crossing]] | None:
    """Return whether a ride 'lasted', 'ended', or ended 'back'wards, and its crossings; None of one that was told to stand."""
    board = Workspace(Path("/nonexistent")).load_board("black" if policy.stem.startswith("black") else "pink")
    protocol = Protocol(terrain="steps")
    rider = policy_named(str(policy), board)
    recording, ending = run_episode(
        protocol_world(board, protocol), rider, protocol, np.random.default_rng([0, episode])
    )
    if recording.column("command")[0, 0] < STILL_SPEED:
        return None
    ended = ending != TIME_LIMIT
    place, heading = recording.column("board_position")[-1, :2], recording.column("board_heading")[-1]
    back = math.cos(heading - down(place)) < 0
    found = crossings(recording, board.geometry["wheelbase"].value, ended and not back)
    return "lasted" if not ended else "back" if back else "ended", found


def by(found: list[Crossing]) -> list[tuple[str, list[Crossing]]]:
    """Return crossings by what may matter."""
    classes = [("all", found)]
    classes += [(f"{1000 * height:.0f} mm", [c for c in found if c.height == height]) for height in STEPS]
    for low, high in ((0, 15), (15, 35), (35, 180)):
        inside = [c for c in found if low <= math.degrees(c.askew) < high]
        classes.append((f"{low}° to {high}° askew", inside))
    for low, high in ((0.0, 0.6), (0.6, 1.0), (1.0, 9.0)):
        classes.append((f"{low:g} to {high:g} m/s", [c for c in found if low <= c.speed < high]))
    for phase in ("pushing", "mounting", "steering", "dismounting"):
        classes.append((phase, [c for c in found if c.phase == phase]))
    return classes


def main() -> None:
    """Ride, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    shipped = [ROOT / "data" / "policies" / f"{name}.onnx" for name in ("pink", "black")]
    parser.add_argument("--policies", type=Path, nargs="*", default=shipped)
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    options = parser.parse_args()
    columns: list[dict[str, str]] = []
    with riders(options.workers) as pool:
        for policy in options.policies:
            rides = (map if pool is None else pool.map)(partial(cross, policy), range(options.episodes))
            rode = [ride for ride in rides if ride is not None]
            how = [said for said, _ in rode]
            lasted, back = how.count("lasted"), how.count("back")
            column = {
                "rides that last": f"{lasted} of {len(rode)}, {text(proportion(lasted, len(rode)))}",
                "of the others, facing back up": f"{back} of {len(rode) - lasted}",
            }
            for name, some in by([crossing for _, found in rode for crossing in found]):
                column[name] = f"{sum(c.fatal for c in some)} of {len(some)}"
            columns.append(column)
    head = ("crossings that ended the ride", *(policy.stem for policy in options.policies))
    rows = [(name, *(column[name] for column in columns)) for name in columns[0]]
    note = f"Rides of 20 s on the suite's ledges, {options.episodes} episodes of seed 0 a policy."
    write_result("ledge_crossings.md", "\n\n".join(("# How policies cross ledges", note, table(head, rows))))


if __name__ == "__main__":
    main()
