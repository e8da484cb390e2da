"""The random suite: what `diagnose` says of logs whose joint, hand, sensor and clock are drawn (`random_truths.py`).

    python benchmarks/random_suite.py --seeds 0:500 --processes 14 --out rows.jsonl --minutes 8
    python benchmarks/reliability.py rows.jsonl

One row a log in JSON lines. Seeds whose row is there already are not run again, so a run may be stopped and go on later,
and ranges of seeds may be run on several machines.
"""

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from random_truths import STIFFNESS, Case, Motion, draw, move, read, sizes, visible, weight, write
from suite import Row, command_line, run_suite
from sysid.diagnosis.judgement import CALIBRATION
from sysid.diagnosis.search import Search

from sysid.board import Board, load_board
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.report import fittable
from sysid.effects import effect
from sysid.fitting.records import make_records, signal_of
from sysid.fitting.search import scales_of
from sysid.logs import read_roll
from sysid.quantity import Quantity
from sysid.releases import find_releases
from sysid.roll import Release

ROOT = Path(__file__).parents[1]
RECORD_STD = 0.003
"""Relative deviation of a record that knows stiffness and damping."""


def board_of(case: Case) -> Board:
    """Return the record that the log is held against."""
    board, truth = load_board(ROOT / "data/boards/pink.toml"), case.truth
    if not case.record_known:
        return board
    rng = np.random.default_rng((3, case.seed))
    stiffness, damping = ((truth.stiffness or STIFFNESS), truth.damping) * (
        1 + RECORD_STD * rng.standard_normal(2)
    )
    return board.with_tilt(
        stiffness=Quantity(stiffness, RECORD_STD * stiffness, "N*m/rad"),
        damping=Quantity(damping, RECORD_STD * damping, "N*m*s/rad"),
    )


def families(names: tuple[str, ...]) -> list[str]:
    return sorted({effect(name).family for name in names})


def missed(case: Case, motion: Motion, releases: Sequence[Release], said: Sequence[Sequence[str]]) -> float:
    """Return χ² of the nearest of some sets of effects against the log without noise, which holds more or something else.

    Where that is small, nobody can tell from the log that they are not all of it.
    """
    kept, recording, nearest = motion.free, case.recording, float("inf")
    _, _, columns = read(case, motion, quiet=True)
    roll = columns.get("roll_rad", motion.states[:, 0])
    rate = columns.get("gyro_x_rad_s")
    signal, quiet = signal_of(releases), list[Release]()
    stamps, half = case.truth.clock * motion.time, 0.5 / recording.rate
    for release in releases:
        # A stamp that jitters is beside its sample: a release that began one later would be taken for a push.
        inside = (stamps >= release.time[0] - half) & (stamps <= release.time[-1] + half)
        touched = ~np.any([(motion.time >= a) & (motion.time <= b) for a, b in kept], axis=0)
        pushed = bool(touched[inside][:1].any()) and recording.pushed
        inside &= ~touched
        if np.count_nonzero(inside) > 30:
            quiet.append(
                replace(
                    release, time=stamps[inside], roll=roll[inside], std=np.full(np.count_nonzero(inside), recording.noise),
                    hold=0.0 if pushed else release.hold, rate=None if rate is None else rate[inside], rate_std=None, own_std=None,
                )
            )  # fmt: skip
    if not quiet:
        return nearest
    records = make_records(quiet, float(weight(recording) ** -0.5), rate=signal["use_rate"])
    held = {} if signal["bias"] == "shared" else {"rest_angle": 0.0}
    search = Search(
        records=records, scales=scales_of(records, board_of(case)), bias=signal["bias"], fixed=held
    )
    linear = search.single(())
    for effects in map(fittable, said):
        # Another number of the record moves as the linear joint does.
        parts = [search.single((name,), linear) for name in effects] or [linear]
        model = parts[0] if len(parts) == 1 else search.union(*parts[:2])
        fine = search.fine(model)
        # How fast a deck starts counts as far as the instant of its release can be seen.
        point = fine.minimum.point
        seen = fine.problem.too_fast(point, 1.0) - fine.problem.start_penalty(point)
        nearest = min(nearest, fine.cost + seen)
    return nearest


def run(seed: int) -> Row:
    """Make and diagnose one log."""
    case = draw(seed)
    truth, recording = case.truth, case.recording
    row: Row = {
        "seed": seed, "kind": case.kind, "truth": truth.name, "families": list(truth.families), "strength": truth.strength,
        "sensor": recording.sensor, "noise_kind": recording.noise_kind, "noise": recording.noise, "rate": recording.rate,
        "jitter": recording.jitter, "drops": recording.drops, "releases": len(recording.angles), "caught": recording.caught,
        "pushed": recording.pushed, "record_known": case.record_known,
    }  # fmt: skip
    try:
        motion = move(case)
        row |= {**sizes(case, motion), **visible(case, motion), "samples": len(motion.time)}
    except ArithmeticError as error:
        return {**row, "status": "void", "error": str(error)}
    try:
        with TemporaryDirectory() as folder:
            path = Path(folder) / f"random-{seed}.csv"
            write(case, motion, path)
            begin = time.perf_counter()
            releases = find_releases(read_roll(path))
            result = diagnose(releases, board_of(case))
            seconds = time.perf_counter() - begin
    except Exception as error:  # noqa: BLE001 - one broken case must not end the suite: it counts as wrong, with its reason
        return {**row, "status": "error", "error": f"{type(error).__name__}: {error}"}
    verdict, floor = result.verdict, result.noise.std
    part = [
        group for group in (verdict.effects, *verdict.indistinguishable_from)
        if (0 < len(group) <= 2 and set(families(group)) < set(truth.families))
        or (case.kind == "outside" and len(group) == 1)
    ]  # fmt: skip
    if verdict.status == "missing" and part:
        row["missed"] = missed(case, motion, releases, part)
    return {
        **row, "status": verdict.status, "effects": list(verdict.effects), "said": sorted(verdict.families),
        "alike": [families(group) for group in verdict.indistinguishable_from], "confidence": verdict.confidence, "calibration": CALIBRATION[verdict.status],
        "explained": verdict.explained, "before": verdict.error_before / floor, "after": verdict.error_after / floor,
        "remainder": verdict.remainder, "found": result.releases, "floor": floor, "seconds": seconds,
        "top": [[list(c.effects), round(c.score, 1), round(c.rmse / floor, 4)] for c in result.candidates[:6]],
    }  # fmt: skip


def say(row: Row) -> None:
    said = ", ".join(row.get("effects", ())) or row["status"]
    print(
        f"{row['seed']:>6} {row['kind']:8s}{row['truth']:32s} -> {said} {row.get('confidence', 0.0):.2f} "
        f"{row.get('after', 0.0):.3f} {row.get('seconds', 0.0):.1f} s {row.get('error', '')}",
        flush=True,
    )


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--seeds", default="0:500", help="FIRST:END")
    parser.add_argument(
        "--kind", choices=("clean", "inside", "outside"), help="of these seeds, only those of one kind"
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument(
        "--out", type=Path, required=True, help="JSON lines: what is there is kept, what is new appended"
    )
    parser.add_argument("--minutes", type=float, default=float("inf"), help="after which no more is run")
    options = parser.parse_args()
    first, end = map(int, options.seeds.split(":"))
    seeds = [(s,) for s in range(first, end) if options.kind in (None, draw(s).kind)]
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # a process a log, and each loads numpy anew
    run_suite(
        run, seeds, ("seed",), options.out, workers=options.processes, seconds=60 * options.minutes, say=say
    )


if __name__ == "__main__":
    main()
