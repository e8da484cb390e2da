"""What `fit --effect learned` makes of torques that no effect of the catalogue is: error on releases nobody saw, and words.

    python benchmarks/learned_torque.py --seeds 10 --out rows.jsonl --processes 16 --minutes 20

The truths and logs are those of `hidden_truths.py`: three releases each. The learned law then predicts
three releases of its own, from angles within what it has seen, with only their roll and rate at release fitted. Rows are
appended as they come; cases whose row is there are not run again.
"""

import os
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ.setdefault("OMP_NUM_THREADS", "1")  # each process is one of many

import numpy as np
from hidden_truths import TRUTHS, board_of, make
from pages import table
from suite import Row, command_line, run_suite

from sysid.diagnosis.learned_torque import learn
from sysid.errors import SysidError
from sysid.fitting.initial_state import fit_initial_states
from sysid.fitting.joint import FitOptions, fit_joint
from sysid.fitting.record_update import require_usable
from sysid.fitting.records import make_records

KINDS = {
    "cogging": ({"cogging"},),
    "magnet in the middle": ({"magnet"}, {"magnet with wide tails"}),
    "damper on one side": ({"one-way damper"},),
    "bumper on one side": ({"right bumper"},),
    "stiffness of the fifth power": ({"fifth power"},),
    "friction like the root of the rate": ({"root of the rate"},),
    "damping by the tilt squared": ({"damping by the tilt squared"},),
    "Bouc-Wen, round corners": (set[str](),),
    "two stops": ({"right bumper", "left bumper"},),
    "spring that loosens": (),
}
"""Kinds and the shapes that are right words for them. Hysteresis has none. A spring that loosens gets a warning."""
CLEAN = ("none", "none, heavy", "none, noise of 5 ms", "none, hum", "none, coarse steps")
NEAR = 1.15
"""Noise floors up to which unseen motion is predicted well."""


def run(name: str, seed: int) -> Row:
    """Learn one log of a truth and return one row."""
    truth, begin = next(t for t in TRUTHS if t.name == name), time.process_time()
    with TemporaryDirectory() as folder:
        releases = make(truth, seed, Path(folder))
    row: Row = {"truth": name, "seed": seed}
    try:
        fit, words = learn(releases, board_of(truth), ["learned"], FitOptions())
    except SysidError as error:
        return {**row, "error": str(error)}
    try:
        require_usable(fit, board_of(truth))
        refused = ""
    except SysidError as error:
        refused = str(error)
    row |= {
        "effects": [n for n, _ in fit.law.effects], "rmse": fit.rmse / fit.noise.std, "refused": refused,
        "warnings": list(fit.warnings), "words": "" if words is None else words.text,
        "shapes": [] if words is None else [s.name for s in words.shapes],
        "good": words is not None and words.good, "share": 0.0 if words is None else words.share,
    }  # fmt: skip
    if truth.outside is not None:
        noise = float(np.median(releases[0].std))
        plain = fit_joint(releases, board_of(truth), [], FitOptions())
        with TemporaryDirectory() as folder:
            unseen = _unseen(truth, seed, Path(folder))
        records = make_records(unseen, noise, rate=False)
        for key, law in (("before", plain.law), ("unseen", fit.law)):
            try:
                residuals, _ = fit_initial_states(law, records)
                row[key] = float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))) / noise
            except SysidError:
                row[key] = float("inf")
    return {**row, "seconds": time.process_time() - begin}


def _unseen(truth: object, seed: int, folder: Path) -> list:
    """Return three releases of the same joint, from smaller angles to the same sides, with noise of their own."""
    from hidden_truths import Truth, _integrated

    assert isinstance(truth, Truth)
    rng = np.random.default_rng(10**6 + seed)
    known = make(truth, seed, folder, quiet=True)
    angles = np.array([r.roll[0] for r in known]) * rng.uniform(0.6, 0.97, len(known))
    noise = float(make(truth, seed, folder)[0].std[0])
    return _integrated(replace(truth), angles, 1000.0, noise, rng, quiet=False)


def summary(rows: list[Row]) -> str:
    """Return the counts and the table of some rows as Markdown."""
    torque = [r for r in rows if r["truth"] in KINDS and KINDS[r["truth"]] and "error" not in r]
    near = [r for r in torque if r["unseen"] <= NEAR]
    clean = [r for r in rows if r["truth"] in CLEAN]
    still = [r for r in clean if "nothing was learned" in r.get("refused", "")]
    right = [name for name in KINDS if _named(name, [r for r in rows if r["truth"] == name])]
    lines = [
        f"- unseen releases within {NEAR} noise floors: {len(near)} of {len(torque)} logs "
        f"({100 * len(near) / max(len(torque), 1):.0f} %)",
        f"- right shape in most logs: {len(right)} of {len(KINDS)} kinds",
        f"- clean logs of which nothing is learned: {len(still)} of {len(clean)} "
        f"({100 * len(still) / max(len(clean), 1):.1f} %)",
        "",
    ]
    head = (
        "truth", "logs", "unseen / noise before", "learned: median, 90 %", "right words", "CPU s", "e.g.",
    )  # fmt: skip
    cells: list[tuple[str, ...]] = []
    for name in (*KINDS, *CLEAN):
        mine = [r for r in rows if r["truth"] == name and "error" not in r]
        if not mine:
            continue
        before, after = (np.array([r[key] for r in mine if key in r]) for key in ("before", "unseen"))
        errors = ("", "")
        if len(after):
            errors = f"{np.median(before):.2f}", f"{np.median(after):.3f}, {np.quantile(after, 0.9):.3f}"
        says = sum(_right(name, r) for r in mine)
        seconds = np.median([r["seconds"] for r in mine])
        words = mine[0]["words"] or "nothing learned"
        cells.append((name, f"{len(mine)}", *errors, f"{says}", f"{seconds:.0f}", words))
    return "\n".join((*lines, table(head, cells)))


def _right(name: str, row: Row) -> bool:
    if name in CLEAN:
        return "nothing was learned" in row["refused"]
    if not KINDS[name]:
        return any("changes with time" in text for text in row["warnings"])
    return set(row["shapes"]) in KINDS[name]


def _named(name: str, rows: list[Row]) -> bool:
    known = [r for r in rows if "error" not in r]
    return bool(known) and sum(_right(name, r) for r in known) > len(known) / 2


def main() -> None:
    """Run what is missing and print the table."""
    parser = command_line(__doc__)
    parser.add_argument("--seeds", type=int, default=0, help="logs of each truth")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--clean", type=int, default=0, help="logs of each clean kind; as many as seeds if 0")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=1e9, help="start no case after so long")
    parser.add_argument("--out", type=Path, default=Path("learned_torque.jsonl"))
    options = parser.parse_args()
    last, clean = options.first + options.seeds, options.first + (options.clean or options.seeds)
    cases = [(name, seed) for seed in range(options.first, last) for name in KINDS]
    cases += [(name, seed) for seed in range(options.first, clean) for name in CLEAN]
    print(
        summary(
            run_suite(
                run,
                cases,
                ("truth", "seed"),
                options.out,
                workers=options.processes,
                seconds=60 * options.minutes,
            )
        )
    )


if __name__ == "__main__":
    main()
