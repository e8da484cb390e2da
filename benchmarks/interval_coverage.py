"""How often the 95 % intervals of `fit` hold the truth: boards, dry friction, white and correlated noise.

Truths are made by `sysid.synth` (event-driven DOP853, hand included) at 10 kHz and sampled at 500 Hz from a
random instant on, so releases fall between samples. The tool then finds the releases and fits them.

    python benchmarks/interval_coverage.py --seeds 1000 --profile --workers 12
    python benchmarks/interval_coverage.py --seeds 200 --draws 200 --only coulomb --workers 12
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pages import table, write_result
from suite import command_line, run_suite

from sysid.board import Board, load_board
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.quantity import Quantity
from sysid.roll import Array, Roll

ROOT = Path(__file__).parents[1]
NOISE = float(np.radians(0.1))
RATE, FINE = 500, 10_000
"""Sampling rates of the logs and of the truth behind them [Hz]."""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    board: str
    damping: float | None = None
    """Instead of the record's [N*m*s/rad]."""
    effects: tuple[tuple[str, tuple[float, ...]], ...] = ()
    correlation: float = 0.0
    """Of the noise, from sample to sample (AR(1))."""

    @property
    def label(self) -> str:
        """Name in the table."""
        board = self.board if self.damping is None else f"{self.board}, d {self.damping:g}"
        return f"{board} | {' + '.join(n for n, _ in self.effects) or '-'} | {f'AR(1) {self.correlation:g}' if self.correlation else 'white'}"


BOARDS = (("pink", None, 0.1), ("pink", 0.04, 0.08), ("black", None, 0.2))
ROWS = [
    Row(board, damping, ((("coulomb", (torque,)),) if friction else ()), correlation)
    for board, damping, torque in BOARDS
    for friction in (False, True)
    for correlation in (0.0, 0.8)
]


@cache
def true_board(row: Row) -> Board:
    """Return the board of a row; its inertia is known exactly, so that the intervals are the decay's own."""
    board = load_board(ROOT / f"data/boards/{row.board}.toml")
    inertia = Quantity(board.inertia.value, 0.0, "kg*m^2", "known exactly")
    board = Board(**{**{name: getattr(board, name) for name in board.__slots__}, "inertia": inertia})
    return board if row.damping is None else board.with_tilt(damping=Quantity(row.damping, 0.0, "N*m*s/rad"))


@cache
def true_motion(row: Row) -> Array:
    """Return the true roll of one log at `FINE` Hz [rad], shape (n,)."""
    from sysid.synth import SynthOptions, synthesise
    from sysid.synth.sensors import Sensor

    options = SynthOptions(angles=(0.19, -0.15, 0.11), rate=FINE, duration=1.2, sensor=Sensor())
    return synthesise(true_board(row), dict(row.effects), options).true_motion[:, 0]


def recorded(row: Row, seed: int) -> Roll:
    """Return what a sensor makes of it."""
    rng = np.random.default_rng([seed, 7])
    step = FINE // RATE
    roll = true_motion(row)[int(rng.integers(step)) :: step]
    noise = rng.standard_normal(len(roll) + 200)
    if row.correlation:
        from scipy.signal import lfilter

        noise = np.sqrt(1 - row.correlation**2) * lfilter([1.0], [1.0, -row.correlation], noise)
    return Roll(
        log="made", time=np.arange(len(roll)) / RATE, roll=roll + NOISE * noise[200:],
        std=np.full(len(roll), NOISE), origin="angle",
    )  # fmt: skip


def truths(row: Row) -> dict[str, float]:
    """Return the true parameters by the names of the fit."""
    board = true_board(row)
    values = {"stiffness": board.stiffness, "damping": board.damping}
    for name, own in row.effects:
        values.update({f"{name}.{p.name}": v for p, v in zip(effect(name).parameters, own, strict=True)})
    return values


def one(number: int, seed: int, profile: bool, draws: int) -> dict[str, Any]:
    """Fit one log; return value, deviation and whether each interval holds the truth, by parameter."""
    from sysid.fitting.bootstrap import bootstrap
    from sysid.fitting.joint import fit_joint
    from sysid.fitting.profile import profiles
    from sysid.releases import find_releases

    row = ROWS[number]
    found: dict[str, Any] = {"row": number, "seed": seed}
    try:
        fit = fit_joint(
            find_releases(recorded(row, seed)), true_board(row), [name for name, _ in row.effects]
        )
    except SysidError as error:
        return {**found, "refused": str(error)}
    found["rmse"] = fit.rmse / NOISE
    found["releases"] = len(fit.records)
    shapes = {p.name: p.interval for p in profiles(fit, true_board(row))} if profile else {}
    drawn = bootstrap(fit, true_board(row), draws, seed=seed).intervals if draws else {}
    for name, truth in truths(row).items():
        q = fit.quantities[name]
        ends = [q.ci95, shapes.get(name), drawn.get(name)]
        found[name] = [q.value, q.std, *(e and bool(e[0] <= truth <= e[1]) for e in ends)]
    return found


KINDS = ("Jacobian", "profile", "bootstrap")


def coverage(results: Sequence[dict[str, Any]]) -> str:
    """Return the coverage of each parameter, with the binomial error of one standard deviation."""
    shown = [k for k in range(3) if any(r["stiffness"][2 + k] is not None for r in results if "rmse" in r)]
    heads = [f"{KINDS[k]} covers %" for k in shown]
    lines: list[tuple[str, ...]] = []
    for index, row in enumerate(ROWS):
        mine = [r for r in results if r["row"] == index and "refused" not in r]
        refused = sum(r["row"] == index and "refused" in r for r in results)
        for name, truth in truths(row).items() if len(mine) > 1 else ():
            value, std = np.array([r[name][:2] for r in mine], dtype=float).T
            spread = (
                float(np.diff(np.quantile(value, [0.1587, 0.8413]))[0]) / 2
            )  # one odd log must not rule it
            cells = [_share([bool(r[name][2 + k]) for r in mine]) for k in shown]
            logs = f"{len(mine)}" + (f" ({refused} refused)" if refused else "")
            off = spread / float(np.median(std)), (float(np.median(value)) - truth) / spread
            lines.append((row.label, logs, name, *cells, f"{off[0]:.3f}", f"{off[1]:+.3f}"))
    head = ("board", "effect", "noise", "logs", "parameter", *heads, "spread / stated", "bias / spread")
    return table(head, lines)


def _share(inside: Sequence[bool]) -> str:
    n, share = len(inside), float(np.mean(inside))
    return f"{100 * share:.1f} ± {100 * float(np.sqrt(max(share * (1 - share), 1 / n) / n)):.1f}"


def main() -> None:
    """Run the rows and write the table."""
    parser = command_line(__doc__)
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", default="")
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("--draws", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rows", type=Path, help="JSON lines: read what is there, append what is new")
    parser.add_argument("--out", default="interval_coverage.md", help="in results/")
    options = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    # Seed by seed over all rows, so that what an interrupted run leaves is whole.
    chosen = [i for i, row in enumerate(ROWS) if options.only in row.label]
    seeds = range(options.first, options.first + options.seeds)
    cases = [(i, s, options.profile, options.draws) for s in seeds for i in chosen]
    results = run_suite(one, cases, ("row", "seed"), options.rows, workers=options.workers)
    write_result(
        options.out,
        "# How often the 95 % intervals hold the truth\n\n"
        f"Three releases at {RATE} Hz, noise 0.1°, found and fitted as `husky-sysid fit` does; "
        f"{options.seeds} logs a row; made by `benchmarks/interval_coverage.py`.\n"
        "Covered: ± one binomial standard deviation. 'Spread / stated' compares the scatter of the values "
        "with the deviation that the tool states (1 is right); 'bias / spread' is 0 without bias.\n\n"
        + coverage(results),
    )


if __name__ == "__main__":
    main()
