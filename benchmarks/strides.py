"""How policies push, stop, and last where it is hard: what a roboticist would ask before the paper's five metrics.

Run `python benchmarks/strides.py [--rides 40] [--workers 16] [--policies data/policies/pink.onnx …]`. Each condition rides
the same episodes with every policy. Stops are drawn over a whole cycle, half of them at 0.6 m/s and half at 1.2 m/s.
"""

import argparse
import math
import os
from concurrent.futures import Executor
from pathlib import Path

from pages import table, write_result

from policy_runtime.evaluation.metrics import METRICS
from policy_runtime.evaluation.plain import Protocol, evaluate_policy, riders
from policy_runtime.evaluation.result import TIME_LIMIT, Evaluation
from policy_runtime.evaluation.statistics import proportion
from policy_runtime.evaluation.stress import Stress
from policy_runtime.evaluation.strides import clip_ranges
from sysid.text import in_brackets
from sysid.workspace import Workspace

ROOT = Path(__file__).parents[1]
SEED = 7
LEVEL = Protocol()
HARD = {
    "level ground": LEVEL,
    "actions 40 ms late": Protocol(stress=Stress(delay=0.04)),
    "soles 0.4 on ground and deck": Protocol(stress=Stress(friction=0.4)),
    "slopes": Protocol(terrain="slopes"),
    "3° uphill": Protocol(stress=Stress(slope=math.radians(3))),
    "3° downhill": Protocol(stress=Stress(slope=-math.radians(3))),
    "speed and turn jump every 3 s, 30 s": Protocol(duration=30.0, jump=3.0),
    "120 s": Protocol(duration=120.0),
}
"""Conditions of rides that shall last."""
STOPS = tuple(Protocol(duration=30.0, speed=(speed, speed), stop=True) for speed in (0.6, 1.2))
SHOWN = (
    "strides", "stride_period", "stance_time", "foot_travel", "slip", "impact", "style_distance", "transport",
    "E_vel", "E_vel_mean_speed", "E_yaw", "E_contact", "E_tilt",
)  # fmt: skip
"""Metrics of rides on level ground."""


def measure(policy: Path, protocol: Protocol, rides: int, workers: int, pool: Executor | None) -> Evaluation:
    """Ride some episodes of a condition."""
    board = Workspace(Path("/nonexistent")).load_board("black" if policy.stem.startswith("black") else "pink")
    return evaluate_policy(
        str(policy),
        board,
        episodes=rides,
        seeds=(SEED,),
        protocol=protocol,
        workers=workers,
        pool=pool,
        force=True,
    )


def share(lasted: int, of: int) -> str:
    """Return a count with the 95 % interval of its share."""
    low, high = proportion(lasted, of).ci95
    return f"{lasted} of {of} [{low:.0%}, {high:.0%}]"


def stopped(results: list[Evaluation], rides: int) -> tuple[str, str]:
    """Return how many of the stops that were given came to rest, and how many rides with a stop lasted."""
    stops = [result.errors["E_stop"] for result in results]
    given = [int(stop.method.split()[2]) for stop in stops]  # "mean over 40 episodes"
    failed = sum(round(stop.value * count) for stop, count in zip(stops, given, strict=True))
    lasted = sum(result.endings.get(TIME_LIMIT, 0) for result in results)
    return share(sum(given) - failed, sum(given)), share(lasted, len(results) * rides)


def main() -> None:
    """Ride, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    shipped = [ROOT / "data" / "policies" / f"{name}.onnx" for name in ("pink", "black")]
    parser.add_argument("--policies", type=Path, nargs="*", default=shipped)
    parser.add_argument("--rides", type=int, default=40)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    options = parser.parse_args()
    rides = options.rides
    level: dict[str, Evaluation] = {}
    rows: dict[str, list[str]] = {name: [] for name in HARD}
    stops: list[tuple[str, str]] = []
    with riders(options.workers) as pool:
        for policy in options.policies:
            for name, protocol in HARD.items():
                result = measure(policy, protocol, rides, options.workers, pool)
                rows[name].append(share(result.endings.get(TIME_LIMIT, 0), rides))
                if protocol is LEVEL:
                    level[policy.stem] = result
            found = [measure(policy, protocol, rides, options.workers, pool) for protocol in STOPS]
            stops.append(stopped(found, rides))
    clips = clip_ranges()
    metrics = [
        (
            f"{name}{'' if METRICS[name] == '1' else f' [{METRICS[name]}]'}",
            "{:.3g} to {:.3g}".format(*clips[name]) if name in clips else "–",
            *(in_brackets(result.errors[name]) for result in level.values()),
        )
        for name in SHOWN
    ]
    lasting = [(name, *cells) for name, cells in rows.items()]
    for place, name in enumerate(("stops below 0.1 m/s within 8 s", "rides with a stop")):
        lasting.append((name, *(cells[place] for cells in stops)))
    note = (
        f"Plain MuJoCo, {rides} episodes of seed {SEED} a condition, {2 * rides} with a stop; 20 s unless another time is given. "
        "In brackets 95 % intervals."
    )
    parts = (
        "# Strides, stops and hard rides",
        note,
        table(("level ground", "reference clips", *level), metrics),
        table(("rides that last", *level), lasting),
    )
    write_result("strides.md", "\n\n".join(parts))


if __name__ == "__main__":
    main()
