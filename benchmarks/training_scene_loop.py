"""The whole loop on synthetic logs: log → fit → bench and scene as MJCF at 5 ms implicitfast → check.

The truth is in continuous time (`sysid.synth`: event-driven DOP853, hand and noise included), four releases
at 1 kHz with 0.1° of noise. 'Typed in' is MuJoCo at this step with the fitted numbers as they are, 'step' the same with
the compensation that `mjcf` makes, both against the fitted law. 'Bench' is the written file, released in stock
MuJoCo, against the truth without noise: it has the errors of fit and step. The rate at release is fitted, because a
semi-implicit step sees velocity half a step before position. 'Scene' is `check`: the deck released in the training
scene, wheels on the ground, against the noisy log, less the noise.

    python benchmarks/training_scene_loop.py
"""

import contextlib
import io
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
from pages import table, write_result
from suite import command_line

from sysid.board import Board, BoardEffect, load_board
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.quantity import Quantity

ROOT = Path(__file__).parents[1]
NOISE_DEG = 0.1
TIMESTEP = 0.005
"""[s]."""


@dataclass(frozen=True)
class Case:
    """A board with something hidden in it."""

    board: str
    effect: str = ""
    values: tuple[float, ...] = ()

    @property
    def limit(self) -> float:
        """Largest NRMSE that the bench may have."""
        return 0.01 if self.effect else 0.005


CASES = [
    Case(board, *hidden)
    for board in ("pink", "black")
    for hidden in (
        (),
        ("coulomb", (0.15,)),
        ("cubic-stiffness", (200.0,)),
        ("quadratic-damping", (0.05,)),
        ("end-stop", (0.08, 60.0, 0.0)),
        ("stribeck", (0.1, 0.2, 0.4)),
    )
]


def true_board(case: Case) -> Board:
    """Return the record that the truth behaves by."""
    board = load_board(ROOT / f"data/boards/{case.board}.toml")
    if not case.effect:
        return board
    pairs = zip(effect(case.effect).parameters, case.values, strict=True)
    part = BoardEffect(case.effect, {p.name: Quantity(v, 0.0, p.unit) for p, v in pairs})
    return replace(board, effects=(part,))


def run(case: Case) -> dict[str, Any]:
    """Run the four commands in a folder of their own."""
    from sysid.cli import build_app

    def called(*words: object) -> None:
        options = {"result_action": "return_value", "exit_on_error": False, "print_error": False}
        build_app()([*map(str, words), "--workspace", folder, "--json", f"{folder}/answer.json"], **options)

    with TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        space = Path(folder)
        log, board = space / "log.csv", ("--board", case.board)

        def answer() -> dict[str, Any]:
            return json.loads((space / "answer.json").read_text())

        hidden = (f"{case.effect}={','.join(map(str, case.values))}",) if case.effect else ()
        effects = [word for text in hidden for word in ("--effect", text)]
        noise = f"{NOISE_DEG}deg"
        called("synth", *board, "-o", log, *effects, "--releases", 4, "--seed", 1, "--noise", noise)
        row: dict[str, Any] = {"case": case}
        try:
            called("fit", log, *board, *(("--effect", case.effect) if case.effect else ()))
            row["fit"] = answer()
            called("mjcf", *board, "-o", space / "bench.xml", "--bench", "--timestep", TIMESTEP)
            row["bench"] = bench_error(case, space / "bench.xml")
            row["uncompensated"] = answer()["decay_nrmse_uncompensated"]
            row["step"] = answer()["decay_nrmse"]
            with contextlib.suppress(SysidError):  # the gate's no is a result too
                called("check", log, *board, "--tolerance", 0.01)
            row["scene"] = answer()["nrmse"]
        except SysidError as error:
            row["refused"] = str(error)
    return row


def bench_error(case: Case, file: Path) -> float:
    """Return the NRMSE of the file's decay in MuJoCo against the true law."""
    from sim.board.clamped import ClampedScene
    from sim.compensation.step import decay_error, release_amplitudes

    truth = true_board(case)
    within = replace(truth, decay={})  # amplitudes as they were recorded, not as published
    scene = ClampedScene(model=mujoco.MjModel.from_xml_path(str(file)))
    return decay_error(truth, scene, release_amplitudes(within))


def cells(row: dict[str, Any]) -> tuple[str, ...]:
    """Return one row of the table."""
    case: Case = row["case"]
    what = f"{case.effect} {', '.join(f'{v:g}' for v in case.values)}".strip() or "-"
    if "refused" in row:
        return case.board, what, f"refused: {row['refused']}", *[""] * 7
    found = row["fit"]["parameters"]
    truth = true_board(case)
    errors = [100 * (found[n]["value"] / truth.tilt[n].value - 1) for n in ("stiffness", "damping")]
    names = list(truth.effects[0].parameters) if case.effect else []
    own = [found[f"{case.effect}.{n}"]["value"] for n in names if f"{case.effect}.{n}" in found]
    shown = ", ".join(f"{value:.4g}" for value in own) or "-"
    met = "yes" if row["bench"] <= case.limit and row["scene"] <= 0.01 else "NO"
    nrmse = (f"{100 * row[name]:.2f}" for name in ("uncompensated", "step", "bench", "scene"))
    return case.board, what, f"{errors[0]:+.2f}", f"{errors[1]:+.2f}", shown, *nrmse, met


def main() -> None:
    """Run all cases and write the table."""
    parser = command_line(__doc__)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", default="")
    parser.add_argument("--out", default="training_scene_loop.md", help="in results/")
    options = parser.parse_args()
    chosen = [case for case in CASES if options.only in f"{case.board} {case.effect}"]
    rows: list[tuple[str, ...]] = []
    with ProcessPoolExecutor(options.workers) as pool:
        for row in pool.map(run, chosen):
            rows.append(cells(row))
            print(*rows[-1], sep=" | ", flush=True)
    head = (
        "board", "hidden", "k error %", "d error %", "effect fitted", "typed in", "step", "bench", "scene", "met",
    )  # fmt: skip
    write_result(
        options.out,
        "# From a log to a training scene that decays like the board\n\n"
        f"{__doc__.split('    python')[0].split(chr(10), 2)[2].strip()}\n\n"
        f"Step {1e3 * TIMESTEP:g} ms, implicitfast, MuJoCo {mujoco.__version__}. NRMSE in %; wanted: bench at most 0.5 "
        "(1 with an effect), scene at most 1. Made by `benchmarks/training_scene_loop.py`.\n\n"
        + table(head, rows),
    )


if __name__ == "__main__":
    main()
