"""How far each policy goes: the suite of `evaluate`, and a map over stiffness, rake, speed and delay, as long as there is time.

Run `python benchmarks/robustness.py [--minutes 10] [--workers 16] [--policies data/policies/*.onnx]`. Every round rides a
few episodes of every condition with a seed of its own; rides are added to `results/robustness.jsonl`, so that a run that is
stopped goes on where it was; those of a policy's earlier weights no longer count where newer ones have ridden. At the end it writes `results/robustness.md` and `../docs/pictures/robustness*.png`.
"""

import argparse
import json
import math
import os
import time
from collections import defaultdict
from concurrent.futures import Executor, ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from pages import table, write_result
from paper.figures import map_figure

from policy_runtime.evaluation.metrics import METRICS
from policy_runtime.evaluation.plain import Protocol, evaluate_policy, riders
from policy_runtime.evaluation.result import TIME_LIMIT
from policy_runtime.evaluation.statistics import proportion
from policy_runtime.evaluation.suite import SUITE
from reports.figures.ride import suite_figure
from sysid.text import in_brackets as text
from sysid.workspace import Workspace

ROOT = Path(__file__).parents[1]
ROWS = Path(__file__).with_name("results") / "robustness.jsonl"
STIFFNESS, RAKE, SPEED, DELAY = (
    (0.0625, 1.0, 10.0, 30.0),
    (0.7, 0.85, 1.0, 1.15),
    (0.4, 0.8, 1.2),
    (0.0, 0.04),
)
"""Of the map: factors of the record's stiffness and rake, [m/s], [s]."""
ERRORS = ("E_vel", "E_yaw", "E_course", "E_tilt", "E_still")


def conditions() -> dict[str, Protocol]:
    """Return what is ridden, by name: the suite, then the maps."""
    found = dict(SUITE)
    for delay in DELAY:
        for speed in SPEED:
            for name, factors in (("k", STIFFNESS), ("rake", RAKE)):
                for factor in factors:
                    found[f"map {name} {factor:g} {speed:g} {delay:g}"] = Protocol(
                        speed=(speed, speed), board_scale={name: factor}, delay=delay
                    )
    return found


Cell = tuple[int, str, Protocol, Path]
"""Seed, name and conditions, and policy of some rides."""


def ride(policies: list[Path], episodes: int, workers: int, deadline: float) -> None:
    """Ride round after round until the time is over; several cells at once, so that no process waits for a long ride."""
    done = {(row["policy"], row["weights"], row["condition"], row["seed"]) for row in read()}
    now = {policy: weights(policy) for policy in policies}
    cells: list[Cell] = [
        (seed, name, protocol, policy)
        for seed in range(1000)
        for name, protocol in conditions().items()
        for policy in policies
        if (policy.stem, now[policy], name, seed) not in done
    ]
    with riders(workers) as pool, ThreadPoolExecutor(8) as threads:

        def add(cell: Cell) -> None:
            if time.monotonic() < deadline:
                _add(cell, episodes, pool)

        for _ in threads.map(add, cells):
            pass


def _add(cell: Cell, episodes: int, pool: Executor | None) -> None:
    """Ride a cell and add its row to the file."""
    seed, name, protocol, policy = cell
    board = Workspace(Path("/nonexistent")).load_board("black" if policy.stem.startswith("black") else "pink")
    result = evaluate_policy(
        str(policy), board, episodes=episodes, seeds=(seed,), protocol=protocol, pool=pool
    )
    rides = rides_of(result.success)
    row = {
        "policy": policy.stem,
        "weights": weights(policy),
        "condition": name,
        "seed": seed,
        "rides": rides,
        "lasted": round(rides * result.success.value) if rides else 0,
        "ended": {k: v for k, v in result.endings.items() if k != TIME_LIMIT},
        **{error: finite(result.errors[error].value) for error in ERRORS},
    }
    with ROWS.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def rides_of(success: Any) -> int:
    """Return how many rides a share is of; its method says it."""
    return 0 if math.isnan(success.value) else int(success.method.split()[1])


def finite(value: float) -> float | None:
    """Return a number for JSON."""
    return value if math.isfinite(value) else None


def weights(policy: Path) -> str:
    """Return what tells a policy from one of the same name with other weights."""
    return sha256(policy.read_bytes()).hexdigest()[:12]


def read() -> list[dict[str, Any]]:
    """Return the rows ridden so far, of the newest weights of each policy and condition."""
    rows = [json.loads(line) for line in ROWS.read_text().splitlines()] if ROWS.exists() else []
    newest = {(row["policy"], row["condition"]): row["weights"] for row in rows}
    return [row for row in rows if row["weights"] == newest[row["policy"], row["condition"]]]


def of_earlier_weights(rows: list[dict[str, Any]]) -> str:
    """Return a sentence on what was ridden by a policy's earlier weights only; nothing where there is none."""
    newest = {row["policy"]: row["weights"] for row in rows}
    stale = {
        (
            row["condition"].split()[0] if row["condition"].startswith("map") else row["condition"],
            row["policy"],
        )
        for row in rows
        if row["weights"] != newest[row["policy"]]
    }
    return "; ".join(f"{condition} ({policy})" for condition, policy in sorted(stale))


def report() -> None:
    """Write table and pictures of all rows."""
    cells: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    ridden = read()
    for row in ridden:
        cells[row["condition"], row["policy"]].append(row)
    policies = sorted({policy for _, policy in cells})
    share = {
        cell: proportion(sum(row["lasted"] for row in rows), sum(row["rides"] for row in rows))
        for cell, rows in cells.items()
    }

    def error(cell: tuple[str, str], name: str) -> str:
        values = [row[name] for row in cells[cell] if row[name] is not None]
        return f"{np.mean(values):.3f}" if values else "–"

    suite = [(name, policy) for name, _ in SUITE for policy in policies if (name, policy) in share]
    rides = {cell: sum(row["rides"] for row in cells[cell]) for cell in suite}
    head = ("condition", "policy", "rides", "E_succ", *(f"{name} [{METRICS[name]}]" for name in ERRORS))
    shown = [
        (*cell, f"{rides[cell]}", text(share[cell]), *(error(cell, name) for name in ERRORS))
        for cell in suite
    ]
    parts = [
        "# How far each policy goes",
        "`benchmarks/robustness.py` writes this file: plain MuJoCo, standing rides left out. 95 % intervals in brackets; "
        "errors are means over the rounds.",
        table(head, shown),
    ]
    if stale := of_earlier_weights(ridden):
        parts.append(f"Ridden by earlier weights of the policy: {stale}.")
    pictures = ROOT / "docs" / "pictures"
    suite_figure(
        [(name, p, share[name, p]) for name, p in suite], "Rides that last", pictures / "robustness.png"
    )
    for name, factors in (("k", STIFFNESS), ("rake", RAKE)):
        rows: list[tuple[str, ...]] = []
        grids: dict[tuple[str, float], list[list[float]]] = {}
        for policy in policies:
            for delay in DELAY:
                grid: list[list[float]] = []
                for speed in SPEED:
                    keys = [(f"map {name} {factor:g} {speed:g} {delay:g}", policy) for factor in factors]
                    if not all(key in share for key in keys):
                        continue
                    grid.append([share[key].value for key in keys])
                    rows.append((policy, f"{delay:g}", f"{speed:g}", *(text(share[key]) for key in keys)))
                if len(grid) == len(SPEED):
                    grids[policy, delay] = grid
        if rows:
            head = ("policy", "delay", "speed", *(f"{factor:g}" for factor in factors))
            title = f"E_succ over {name}, of the record's, for each speed [m/s] and delay [s]:"
            parts += [title, table(head, rows)]
        if grids and name == "k":  # of the rake every ride lasts
            map_figure(grids, factors, SPEED, pictures / "robustness-k.png")
    write_result("robustness.md", "\n\n".join(parts))


def main() -> None:
    """Ride for so long, and write what is known by then."""
    parser = argparse.ArgumentParser(description=__doc__)
    shipped = sorted((ROOT / "data" / "policies").glob("*.onnx"))
    parser.add_argument("--policies", type=Path, nargs="*", default=shipped)
    parser.add_argument("--episodes", type=int, default=16, help="of a condition and round")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--minutes", type=float, default=10.0)
    options = parser.parse_args()
    ride(options.policies, options.episodes, options.workers, time.monotonic() + 60 * options.minutes)
    report()


if __name__ == "__main__":
    main()
