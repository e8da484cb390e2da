"""The hidden-effect suite: logs whose truth nobody told the tool, and what it says of them.

Truths of the catalogue are made by `sysid.synth` (event-driven DOP853, hand and sensor included), those outside
the catalogue by a DOP853 integration here. Neither shares code with the fit.

    python benchmarks/hidden_effects.py --seeds 1 --write docs/diagnosis.md
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from sysid.board import Board, load_board
from sysid.diagnose import Diagnosis, diagnose
from sysid.logs import read_roll
from sysid.quantity import Quantity
from sysid.releases import find_releases
from sysid.roll import Release

ROOT = Path(__file__).parents[1]
LIGHT = 0.04
"""Damping of the lightly damped board [N*m*s/rad]."""
NOISES_DEG = (0.04, 0.1, 0.2)
RATES = (200.0, 500.0, 1000.0)
Torque = Callable[[float, float, float], float]


@dataclass(frozen=True)
class Truth:
    """What is hidden in a log."""

    name: str
    effects: dict[str, tuple[float, ...]]
    light: bool = True
    outside: Torque | None = None
    """Torque of (time, tilt, rate) that no effect of the catalogue makes."""
    noises: tuple[float, ...] = NOISES_DEG
    rates: tuple[float, ...] = RATES

    @property
    def expected(self) -> frozenset[str]:
        return frozenset(self.effects)


def _both(name: str, *values: tuple[float, ...], heavy: Sequence[tuple[float, ...]] = ()) -> list[Truth]:
    light = [Truth(f"{name} {_text(v)}", {name: v}) for v in values]
    return light + [Truth(f"{name} {_text(v)}, heavy", {name: v}, light=False) for v in heavy]


def _text(values: tuple[float, ...]) -> str:
    return ",".join(f"{v:g}" for v in values)


TRUTHS: list[Truth] = [
    Truth("none", {}),
    Truth("none, heavy", {}, light=False),
    *_both("coulomb", (0.03,), (0.1,), heavy=[(0.15,)]),
    *_both("stribeck", (0.05, 0.2, 0.4)),
    *_both("quadratic-damping", (0.008,), (0.03,), heavy=[(0.1,)]),
    *_both("cubic-damping", (0.003,), (0.015,), heavy=[(0.05,)]),
    *_both("cubic-stiffness", (60.0,), (250.0,), (-60.0,), heavy=[(300.0,)]),
    *_both("asymmetric-stiffness", (8.0,), (-25.0,), heavy=[(40.0,)]),
    *_both("end-stop", (0.1, 40.0), (0.13, 100.0), heavy=[(0.08, 80.0)]),
    *_both("freeplay", (0.006,), (0.02,), heavy=[(0.02,)]),
    *_both("viscoelastic", (3.0, 0.06), (2.0, 0.3)),
    *_both("hysteresis", (6.0, 0.15), (15.0, 0.1)),
    *_both("second-mode", (0.004, 120.0, 0.05), (0.02, 150.0, 0.3)),
    *_both("offset", (0.015,), heavy=[(-0.01,)]),
    *_both("preload", (0.2,)),
    *_both("sensor-bias", (-0.02,)),
    *_both("inertia", (1.3,), heavy=[(0.8,)]),
    *_both("gravity", (1.5,)),
    Truth("coulomb and cubic-stiffness", {"coulomb": (0.08,), "cubic-stiffness": (150.0,)}),
    Truth("quadratic-damping and cubic-stiffness", {"quadratic-damping": (0.03,), "cubic-stiffness": (-80.0,)}),
    Truth("coulomb and asymmetric-stiffness", {"coulomb": (0.06,), "asymmetric-stiffness": (20.0,)}),
    Truth("freeplay and coulomb", {"freeplay": (0.015,), "coulomb": (0.05,)}),
    Truth("cogging", {}, outside=lambda t, x, v: -0.1 * np.sin(60 * x), noises=(0.04, 0.1)),
    Truth("magnet in the middle", {}, outside=lambda t, x, v: -12 * x / (1 + (x / 0.02) ** 2) ** 2, noises=(0.04, 0.1)),
    Truth("damper on one side", {}, outside=lambda t, x, v: -0.08 * max(v, 0.0), noises=(0.04, 0.1)),
    Truth("bumper on one side", {}, outside=lambda t, x, v: -25 * max(x - 0.06, 0.0), noises=(0.04, 0.1)),
    Truth("spring that loosens", {}, outside=lambda t, x, v: 1.5 * x * (1 - np.exp(-t / 0.5)), noises=(0.04, 0.1)),
    Truth("friction like the root of the rate", {}, outside=lambda t, x, v: -0.09 * np.sign(v) * np.sqrt(abs(v)), noises=(0.04, 0.1)),
    Truth("damping by the tilt", {}, outside=lambda t, x, v: -0.6 * abs(x) * v, noises=(0.04, 0.1)),
    Truth("damping by the tilt squared", {}, outside=lambda t, x, v: -5.0 * x * x * v, noises=(0.04, 0.1)),
    Truth("stiffness of the fifth power", {}, outside=lambda t, x, v: -3000.0 * x**5, noises=(0.04, 0.1)),
    Truth("periodic torque", {}, outside=lambda t, x, v: 0.06 * np.sin(2 * np.pi * 3 * t), noises=(0.04, 0.1)),
    Truth("two stops", {}, outside=lambda t, x, v: -60 * (max(x - 0.12, 0.0) + min(x + 0.06, 0.0)), noises=(0.04, 0.1)),
]  # fmt: skip
LOOK_ALIKES = (
    {"offset", "preload", "sensor-bias"},
    {"inertia", "clock"},
)
"""Sets that no free decay tells apart (proved in tests/test_look_alikes.py): naming one names all."""


def board_of(truth: Truth) -> Board:
    board = load_board(ROOT / "data/boards/pink.toml")
    return board.with_tilt(damping=Quantity(LIGHT, 2e-4, "N*m*s/rad")) if truth.light else board


def make(truth: Truth, seed: int, folder: Path) -> list[Release]:
    """Return three releases of a truth; noise, rate and angles go by the seed."""
    rng = np.random.default_rng(1000 + seed)
    noise = np.radians(rng.choice(truth.noises))
    rate = float(rng.choice(truth.rates))
    angles = rng.uniform(0.85, 1.1, 3) * np.array([0.19, -0.15, 0.11])
    if truth.outside is not None:
        return _outside(truth, angles, rate, noise, rng)
    from sysid.synth import SynthOptions, synthesise
    from sysid.synth_sensors import Sensor

    options = SynthOptions(
        angles=tuple(map(float, angles)),
        rate=rate,
        duration=2.0,
        seed=seed,
        sensor=Sensor(noise=float(noise)),
    )
    path = folder / f"{abs(hash(truth.name))}-{seed}.csv"
    synthesise(board_of(truth), truth.effects, options).save(path)
    return find_releases(read_roll(path))


def _outside(
    truth: Truth, angles: np.ndarray, rate: float, noise: float, rng: np.random.Generator
) -> list[Release]:
    from scipy.integrate import solve_ivp

    board, t = board_of(truth), np.arange(0, 2.0, 1 / rate)
    torque = truth.outside
    assert torque is not None
    releases: list[Release] = []
    for number, angle in enumerate(angles, start=1):
        path = solve_ivp(
            lambda t, y: [
                y[1],
                (-board.stiffness * y[0] - board.damping * y[1] + torque(t, y[0], y[1])) / board.inertia.value,
            ],
            (0, 2.0), [angle, 0.0], t_eval=t, method="DOP853", rtol=1e-8, atol=1e-10, max_step=2e-3,
        )  # fmt: skip
        still = np.abs(path.y[0][-len(t) // 5 :]).max() < 0.3 * noise
        releases.append(
            Release(
                log=truth.name, number=number, time=t, roll=path.y[0] + noise * rng.standard_normal(len(t)),
                std=np.full(len(t), noise), origin="angle", rest=0.0, hold=1.0, end="rest" if still else "log",
            )
        )  # fmt: skip
    return releases


def right(truth: Truth, result: Diagnosis) -> bool:
    """Whether the verdict is right: the effects, or a set of look-alikes that contains them."""
    verdict = result.verdict
    if truth.outside is not None:
        return verdict.status == "unexplained"
    if not truth.effects:
        return verdict.status == "none-missing"
    said = [frozenset(verdict.effects), *map(frozenset, verdict.indistinguishable_from)]
    return any(_same(truth.expected, group) for group in said)


def _same(expected: frozenset[str], said: frozenset[str]) -> bool:
    def generic(names: frozenset[str]) -> frozenset[str]:
        table = {name: min(group) for group in LOOK_ALIKES for name in group}
        return frozenset(table.get(name, name) for name in names)

    return generic(expected) == generic(said)


def run(case: tuple[int, int]) -> dict[str, object]:
    """Diagnose one log and return one row of the result."""
    truth, seed = TRUTHS[case[0]], case[1]
    with TemporaryDirectory() as folder:
        releases = make(truth, seed, Path(folder))
    begin = time.perf_counter()
    result = diagnose(releases, board_of(truth), workers=1)
    verdict = result.verdict
    return {
        "truth": truth.name, "seed": seed, "right": right(truth, result), "status": verdict.status,
        "effects": list(verdict.effects), "alike": [list(g) for g in verdict.indistinguishable_from],
        "confidence": verdict.confidence, "before": verdict.error_before / result.noise.std,
        "after": verdict.error_after / result.noise.std, "seconds": time.perf_counter() - begin,
        "inside": truth.outside is None and bool(truth.effects), "none": not truth.effects and truth.outside is None,
    }  # fmt: skip


def table(rows: Sequence[dict[str, object]]) -> str:
    """Return the confusion matrix and the targets as Markdown."""

    def text(row: dict[str, object]) -> str:
        if row["status"] != "missing":
            return str(row["status"])
        said = [row["effects"], *row["alike"]]  # type: ignore[misc]
        return " / ".join(" + ".join(group) for group in said)

    lines = ["| hidden | verdicts | right | error / noise before | after |", "|---|---|---|---|---|"]
    for name in dict.fromkeys(str(row["truth"]) for row in rows):
        mine = [row for row in rows if row["truth"] == name]
        answers: dict[str, int] = {}
        for row in mine:
            answers[text(row)] = answers.get(text(row), 0) + 1
        said = "; ".join(f"{count} x {answer}" for answer, count in answers.items())
        hits = sum(bool(row["right"]) for row in mine)
        before, after = (np.mean([float(row[key]) for row in mine]) for key in ("before", "after"))  # type: ignore[arg-type]
        lines.append(f"| {name} | {said} | {hits} of {len(mine)} | {before:.2f} | {after:.3f} |")
    groups = {
        "right effect, or a set of look-alikes with it": [r for r in rows if r["inside"]],
        "no alarm where nothing is hidden": [r for r in rows if r["none"]],
        "'unexplained' outside the catalogue": [r for r in rows if not r["inside"] and not r["none"]],
    }
    summary = [
        f"- {name}: {sum(bool(r['right']) for r in group)} of {len(group)}"
        for name, group in groups.items()
        if group
    ]
    return "\n".join((*summary, "", *lines))


def write(path: Path, rows: Sequence[dict[str, object]]) -> None:
    """Put the table between the marks of a document."""
    text = path.read_text(encoding="utf-8")
    begin, end = text.index("<!-- suite -->") + len("<!-- suite -->"), text.index("<!-- end -->")
    path.write_text(f"{text[:begin]}\n{table(rows)}\n{text[end:]}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", default="")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    cases = [
        (i, seed)
        for seed in range(options.first, options.first + options.seeds)
        for i, truth in enumerate(TRUTHS)
        if options.only in truth.name
    ]
    rows: list[dict[str, object]] = []
    with ProcessPoolExecutor(options.workers) as pool:
        for row in pool.map(run, cases):
            rows.append(row)
            mark = "ok " if row["right"] else "BAD"
            print(mark, row["truth"], row["seed"], row["status"], row["effects"], "~", row["alike"], f"{row['before']:.2f} -> {row['after']:.3f}", f"{row['seconds']:.1f} s", flush=True)  # fmt: skip
    for what in ("inside", "none"):
        chosen = [r for r in rows if r[what]]
        if chosen:
            print(what, sum(bool(r["right"]) for r in chosen), "of", len(chosen))
    outside = [r for r in rows if not r["inside"] and not r["none"]]
    print("outside", sum(bool(r["right"]) for r in outside), "of", len(outside))
    if options.write:
        write(options.write, rows)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
