"""The random suite: does `diagnose` name the families of random logs (`decay_truths.py`)?

    python benchmarks/decay_suite_diagnose.py --seeds 0:200 --processes 8 --out rows.jsonl

One row a log. The last lines say how many are right by kind, and how the stated confidence compares with that.
"""

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from decay_truths import draw

from sysid.board import load_board
from sysid.diagnosis.diagnose import diagnose
from sysid.effects import effect
from sysid.quantity import Quantity

ROOT = Path(__file__).parents[1]


def run(seed: int) -> dict[str, Any]:
    """Make and diagnose one log; the record knows the inertia only."""
    np.seterr(all="ignore")
    begin = time.process_time()
    row: dict[str, Any] = {"seed": seed}
    try:
        truth, recording = draw(seed)
    except Exception as error:  # noqa: BLE001 - a log in which nothing can be found is not the subject
        return {**row, "status": "void", "error": str(error)[:200]}
    row |= {"kind": truth.kind, "families": truth.families, "omega": truth.omega, "zeta": truth.zeta, "bent": truth.bent, "hand": truth.hand, "sensor": truth.sensor, "law": [n for n, _, _ in truth.laws]}  # fmt: skip
    made = time.process_time()
    board = load_board(ROOT / "data/boards/pink.toml")
    unknown = {name: replace(q, std=0.0) for name, q in board.tilt.items()}
    board = replace(board, tilt=unknown, inertia=Quantity(1.0, 0.01, "kg*m^2"))
    try:
        found = diagnose(recording, board)
    except Exception as error:  # noqa: BLE001 - counted as wrong
        return {
            **row,
            "status": "error",
            "error": repr(error)[:300],
            "right": False,
            "cpu": time.process_time() - made,
        }
    verdict = found.verdict
    named = sorted({effect(e).family for e in verdict.effects} - {"rest", "inertia", "clock"})
    alike = [sorted({effect(e).family for e in group} - {"rest"}) for group in verdict.indistinguishable_from]
    if truth.kind == "outside":
        right = verdict.status == "unexplained"
    else:
        right = verdict.status != "unexplained" and named == sorted(truth.families)
    return {
        **row, "status": verdict.status, "named": named, "alike": alike, "right": right, "confidence": verdict.confidence,
        "before": found.baseline.rmse / found.noise.std, "after": found.best.rmse / found.noise.std, "share": found.posterior.share,
        "nameless": found.posterior.nameless, "cycles": found.posterior.by_cycles, "cpu": time.process_time() - made, "made": made - begin,
    }  # fmt: skip


def table(rows: list[dict[str, Any]]) -> None:
    """Print how many are right by kind, and the confidence against it."""
    rows = [r for r in rows if r["status"] != "void"]
    for name, pick in (
        ("known, as written", lambda r: r["kind"] == "known" and not r["bent"]),
        ("known, bent", lambda r: r["kind"] == "known" and r["bent"]),
        ("clean", lambda r: r["kind"] == "clean"),
        ("outside", lambda r: r["kind"] == "outside"),
    ):
        part = [r for r in rows if pick(r)]
        if part:
            alike = sum(r["right"] or sorted(r["families"]) in r.get("alike", []) for r in part)
            print(
                f"{name:20s} {sum(r['right'] for r in part):4d} of {len(part):4d}, with look-alikes {alike}"
            )
    sure = [r for r in rows if "confidence" in r]
    for low, high in ((0, 0.6), (0.6, 0.8), (0.8, 0.9), (0.9, 0.97), (0.97, 1.01)):
        part = [r for r in sure if low <= r["confidence"] < high and r["kind"] != "outside"]
        if part:
            print(
                f"confidence {np.mean([r['confidence'] for r in part]):.2f}: right {np.mean([r['right'] for r in part]):.2f} of {len(part)}"
            )
    cpu = [r["cpu"] for r in rows]
    print(
        f"CPU s: median {np.median(cpu):.1f}, 90 % {np.quantile(cpu, 0.9):.1f}, most {max(cpu):.1f}; {len(rows)} logs"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0:60")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    first, last = map(int, options.seeds.split(":"))
    rows: list[dict[str, Any]] = []
    with ProcessPoolExecutor(options.processes) as pool:
        for job in as_completed([pool.submit(run, seed) for seed in range(first, last)]):
            row = job.result()
            rows.append(row)
            if options.out:
                with options.out.open("a") as file:
                    file.write(json.dumps(row, default=str) + "\n")
            print(row.get("right"), row, flush=True)
    table(rows)


if __name__ == "__main__":
    main()
