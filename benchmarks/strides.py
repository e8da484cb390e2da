"""How policies push, stop, and last where it is hard: what a roboticist would ask before the paper's five metrics.

Run `python benchmarks/strides.py [--rides 16] [--workers 16] [--policies data/policies/pink.onnx …]`. Each condition rides
the same episodes with every policy. Stops are drawn over a whole cycle. Rides are kept in `results/strides.jsonl`, so that a
run that is stopped goes on. At the end it writes `results/strides.md`.
"""

import argparse
import json
import math
import os
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from pages import table, write_result
from robustness import weights

from policy_runtime.evaluation.metrics import METRICS, clip_ranges
from policy_runtime.evaluation.plain import Protocol, evaluate_policy, riders
from policy_runtime.evaluation.result import TIME_LIMIT
from policy_runtime.evaluation.statistics import proportion
from sysid.workspace import Workspace

ROOT = Path(__file__).parents[1]
ROWS = Path(__file__).with_name("results") / "strides.jsonl"
SEED = 7
LEVEL = "level ground"
CONDITIONS = {
    LEVEL: Protocol(),
    "actions 40 ms late": Protocol(delay=0.04),
    "soles 0.4 on ground and deck": Protocol(friction=0.4),
    "slopes": Protocol(terrain="slopes"),
    "3° uphill": Protocol(slope=math.radians(3)),
    "3° downhill": Protocol(slope=-math.radians(3)),
    "120 s": Protocol(duration=120.0),
    "a stop at 0.6 m/s, 30 s": Protocol(duration=30.0, speed=(0.6, 0.6), stop=True),
    "a stop at 1.2 m/s, 30 s": Protocol(duration=30.0, speed=(1.2, 1.2), stop=True),
    "speed and turn jump every 3 s, 30 s": Protocol(duration=30.0, jump=3.0),
}
SHOWN = (
    "strides", "stride_period", "stance_time", "foot_travel", "slip", "impact", "style_distance", "transport",
    "E_vel", "E_vel_mean_speed", "E_yaw", "E_contact", "E_tilt",
)  # fmt: skip
"""Metrics of rides on level ground."""


Row = dict[str, Any]
"""Rides of one policy under one condition."""


def measure(policy: Path, condition: str, rides: int, pool: Executor | None) -> Row:
    """Ride some episodes of a condition."""
    board = Workspace(Path("/nonexistent")).load_board("black" if policy.stem.startswith("black") else "pink")
    found = evaluate_policy(
        str(policy), board, episodes=rides, seeds=(SEED,), protocol=CONDITIONS[condition], pool=pool,
        force=True,
    )  # fmt: skip
    errors = {name: [one.value, *one.ci95] for name, one in found.errors.items() if math.isfinite(one.std)}
    stops = found.errors["E_stop"].method.split()  # "mean over 16 episodes"
    return {
        "policy": policy.stem,
        "weights": weights(policy),
        "condition": condition,
        "rides": rides,
        "lasted": found.endings.get(TIME_LIMIT, 0),
        "stops": int(stops[2]) if "E_stop" in errors else 0,
        "errors": {name: [round(value, 4) for value in values] for name, values in errors.items()},
    }


def share(count: int, of: int) -> str:
    """Return a count with the 95 % interval of its share."""
    low, high = proportion(count, of).ci95
    return f"{count} of {of} [{low:.0%}, {high:.0%}]"


def read(policies: list[Path]) -> dict[tuple[str, str], Row]:
    """Return the rows ridden so far with the present weights, by policy and condition."""
    now = {policy.stem: weights(policy) for policy in policies}
    rows = [json.loads(line) for line in ROWS.read_text().splitlines()] if ROWS.exists() else []
    return {
        (row["policy"], row["condition"]): row for row in rows if row["weights"] == now.get(row["policy"])
    }


def level_table(names: list[str], rows: dict[tuple[str, str], Row]) -> str:
    """Return the metrics on level ground beside the reference clips'."""
    clips = clip_ranges()

    def cell(policy: str, name: str) -> str:
        values = rows.get((policy, LEVEL), {"errors": {}})["errors"].get(name)
        return "–" if values is None else "{:.3g} [{:.3g}, {:.3g}]".format(*values)

    metrics = [
        (
            f"{name}{'' if METRICS[name] == '1' else f' [{METRICS[name]}]'}",
            "{:.2g} to {:.2g}".format(*clips[name]) if name in clips else "–",
            *(cell(policy, name) for policy in names),
        )
        for name in SHOWN
    ]
    return table((LEVEL, "reference clips", *names), metrics)


def lasting_table(names: list[str], rows: dict[tuple[str, str], Row]) -> str:
    """Return how many rides last, and how many stops come to rest."""
    lines: list[tuple[str, ...]] = []
    for condition in CONDITIONS:
        found = [rows.get((policy, condition)) for policy in names]
        lines.append(
            (condition, *("–" if row is None else share(row["lasted"], row["rides"]) for row in found))
        )
        if CONDITIONS[condition].stop:
            cells = [
                "–"
                if row is None or not row["stops"]
                else share(round((1 - row["errors"]["E_stop"][0]) * row["stops"]), row["stops"])
                for row in found
            ]
            lines.append(("… below 0.1 m/s after 8 s", *cells))
    return table(("rides that last", *names), lines)


def main() -> None:
    """Ride, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    shipped = [
        ROOT / "data" / "policies" / f"{board}{kind}.onnx"
        for kind in ("", "-strides")
        for board in ("pink", "black")
    ]
    parser.add_argument("--policies", type=Path, nargs="*", default=shipped)
    parser.add_argument("--conditions", nargs="*", choices=CONDITIONS, default=list(CONDITIONS))
    parser.add_argument("--rides", type=int, default=16)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    options = parser.parse_args()
    with riders(options.workers) as pool:
        for policy in options.policies:
            for condition in options.conditions:
                if (policy.stem, condition) not in read([policy]):
                    row = measure(policy, condition, options.rides, pool)
                    with ROWS.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(row) + "\n")
    rows = read(shipped)
    names = [policy.stem for policy in shipped]
    note = f"Plain MuJoCo, episodes of seed {SEED}, 20 s unless another time is given. In brackets 95 % intervals."
    parts = ("# Strides, stops and hard rides", note, level_table(names, rows), lasting_table(names, rows))
    write_result("strides.md", "\n\n".join(parts))


if __name__ == "__main__":
    main()
