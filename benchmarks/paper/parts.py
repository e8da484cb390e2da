"""The parts of the paper: each measures what it shows and returns a section of text, numbers and a picture."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from paper.figures import curves_figure, map_figure, trajectories_figure
from paper.published import MAIN, METRICS, SENSITIVITY, TERRAIN, Row
from paper.runs import Run
from policy_runtime.evaluation.protocol import Protocol
from policy_runtime.evaluation.result import Evaluation
from sysid.quantity import Quantity
from sysid.text import in_brackets as text

Measure = Callable[[Run, Protocol], Evaluation]
"""Rides a run's policy on its board."""
MAP_STIFFNESS = (0.25, 1.0, 4.0, 16.0)
"""Factors of the record's stiffness."""
MAP_SPEED = (0.4, 0.8, 1.2)
"""[m/s]"""
MAP_DELAY = (0.0, 0.02, 0.04)
"""[s]"""
HEADINGS = (-45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0)
"""Edges of the classes of turns asked for [°]."""
CURVES = (
    ("survival", "episodes that last", "1"),
    ("speed_error", "E_vel in training", "m/s"),
    ("heading_error", "E_yaw in training", "rad"),
    ("both_feet", "both feet on deck, steering", "1"),
)
"""Columns of the curves, and what they are."""


@dataclass(frozen=True, slots=True)
class Section:
    """One table or figure."""

    title: str
    lines: list[str]
    """Markdown."""
    numbers: Any
    """For machines."""
    picture: str | None = None
    missing: list[str] = field(default_factory=list[str])
    """Rows for which there is no run."""


def main_table(runs: Sequence[Run], measure: Measure, folder: Path) -> Section:
    """Measure every row of the paper's main table that has been trained."""
    return _table("Main table", MAIN, runs, measure)


def sensitivity(runs: Sequence[Run], measure: Measure, folder: Path) -> Section:
    """Measure what the guidance of transitions bears."""
    return _table("Sensitivity of the transitions' guidance", SENSITIVITY, runs, measure)


def trajectories(runs: Sequence[Run], measure: Measure, folder: Path) -> Section:
    """Draw the paths of a policy on steered trucks and on straight ones (the paper's figure 4a)."""
    results = [
        (run.name, name, measure(run, protocol))
        for run in _of_rows(runs, ("husky", "no-coupling"))
        for name, protocol in (
            ("trucks steered", Protocol()),
            ("trucks held straight", Protocol(coupling="none")),
        )
    ]
    picture = folder / "trajectories.png"
    trajectories_figure([(f"{run}, {name}", one.paths) for run, name, one in results], picture)
    rows = [
        (run, name, text(one.success), text(one.errors["E_yaw"]), _turned(one)) for run, name, one in results
    ]
    lines = _markdown(("policy", "board", "E_succ", "E_yaw [rad]", "share of the asked turn"), rows)
    numbers = [{"run": run, "board": name, **one.to_json()} for run, name, one in results]
    lacks = not _of_rows(runs, ("no-coupling",))
    missing = ["a policy trained on straight trucks (no-coupling)"] if lacks else []
    return Section("Trajectories (figure 4a)", lines, numbers, picture.name, missing)


def headings(runs: Sequence[Run], measure: Measure, folder: Path) -> Section:
    """Measure which headings a policy reaches in one steering phase (the paper's figure 4b)."""
    rows: list[tuple[str, ...]] = []
    numbers: list[dict[str, Any]] = []
    for run in _of_rows(runs, ("husky", "no-coupling")):
        asked, done, _ = np.degrees(measure(run, Protocol()).headings).T
        for low, high in pairwise(HEADINGS):
            reached = done[(asked >= low) & (asked < high)]
            if not len(reached):
                continue
            mean, spread = float(reached.mean()), float(reached.std())
            rows.append(
                (run.name, f"{low:+.0f} to {high:+.0f}", f"{mean:+.1f}", f"{spread:.1f}", str(len(reached)))
            )
            numbers.append({"run": run.name, "asked_deg": [low, high], "mean_deg": mean, "std_deg": spread})
    head = ("policy", "asked [°]", "reached, mean [°]", "standard deviation [°]", "turns")
    return Section("Reachable headings (figure 4b)", _markdown(head, rows), numbers)


def learning_curves(runs: Sequence[Run], measure: Measure, folder: Path) -> Section:
    """Draw the learning curves. The paper's figure 5 shows where one seed explores, which nothing here draws."""
    curves = {run.name: run.read_curves() for run in runs if run.curves is not None}
    picture = folder / "curves.png"
    curves_figure(curves, CURVES, picture)
    ends = {name: rows[-1] for name, rows in curves.items()}
    body: list[tuple[str, ...]] = []
    for name, row in ends.items():
        learned = f"{row['iteration']:,.0f}", f"{row['samples'] / 1e6:,.0f}"
        body.append((name, *learned, *(f"{row[key]:.3g}" for key, *_ in CURVES)))
    head = ("run", "iterations", "million steps", *(f"{title} [{unit}]" for _, title, unit in CURVES))
    numbers = {
        name: {key: value for key, value in row.items() if math.isfinite(value)} for name, row in ends.items()
    }
    title = "Learning curves, and where they end"
    return Section(title, _markdown(head, body), numbers, picture.name)


def success_map(runs: Sequence[Run], measure: Measure, folder: Path) -> Section:
    """Measure E_succ over stiffness, speed and delay (more of what the paper's figure 8 asks)."""
    cells: list[dict[str, Any]] = []
    grids: dict[tuple[str, float], list[list[float]]] = {}
    for run in _of_rows(runs, ("husky",)):
        for delay in MAP_DELAY:
            grid: list[list[float]] = []
            for v in MAP_SPEED:
                grid.append([])
                for k in MAP_STIFFNESS:
                    protocol = Protocol(speed=(v, v), board_scale={"k": k}, delay=delay)
                    success = measure(run, protocol).success
                    place = {"run": run.name, "delay": delay, "speed": v, "k_factor": k}
                    grid[-1].append(success.value)
                    cells.append({**place, "E_succ": success.to_json()})
            grids[run.name, delay] = grid
    picture = folder / "map.png"
    map_figure(grids, MAP_STIFFNESS, MAP_SPEED, picture)
    rows: list[tuple[str, ...]] = []
    for cell in cells:
        place = f"{cell['delay'] * 1e3:.0f}", f"{cell['speed']:g}", f"{cell['k_factor']:g}"
        success, (low, high) = cell["E_succ"]["value"], cell["E_succ"]["ci95"]
        rows.append((cell["run"], *place, f"{success:.3g} [{low:.2g}, {high:.2g}]"))
    lines = _markdown(("policy", "delay [ms]", "v [m/s]", "k, of the record's", "E_succ"), rows)
    return Section("E_succ over stiffness, speed and delay (figure 8)", lines, cells, picture.name)


def terrain(runs: Sequence[Run], measure: Measure, folder: Path) -> Section:
    """Measure the policies on slopes and ledges."""
    results = [
        (run.name, ground, measure(run, Protocol(terrain=ground)))
        for run in _of_rows(runs, ("husky",))
        for ground in ("slopes", "steps")
    ]
    rows: list[tuple[str, ...]] = []
    for run, ground, one in results:
        errors = (text(one.errors[name]) for name in ("E_vel", "E_yaw"))
        rows.append((run, ground, text(one.success), f"{TERRAIN[ground].value:.2f}", *errors))
    head = ("policy", "ground", "E_succ", "the paper's E_succ, its ground", "E_vel [m/s]", "E_yaw [rad]")
    numbers = [{"run": run, "ground": ground, **one.to_json()} for run, ground, one in results]
    return Section("Terrain", _markdown(head, rows), numbers)


PARTS = {
    "main": main_table,
    "trajectories": trajectories,
    "headings": headings,
    "curves": learning_curves,
    "map": success_map,
    "terrain": terrain,
    "sensitivity": sensitivity,
}
"""By the names that the command takes."""


def _table(title: str, rows: Sequence[Row], runs: Sequence[Run], measure: Measure) -> Section:
    body: list[tuple[str, ...]] = []
    words: list[str] = []
    numbers: list[dict[str, Any]] = []
    missing: list[str] = []
    for row in rows:
        if row.figures:
            body.append((row.title, "paper", *(f"{q.value:.3f} ± {q.std:.3f}" for q in row.figures.values())))
        found = _of_rows(runs, (row.key,))
        if not found:
            body.append((row.title, "not trained", *["–"] * len(METRICS)))
            missing.append(f"{row.title}: husky-sysid train {row.options}".strip())
        for run in found:
            result = measure(run, Protocol())
            ours = {name: result.success if name == "E_succ" else result.errors[name] for name in METRICS}
            body.append((row.title, f"{run.name} on {run.board}", *(text(value) for value in ours.values())))
            numbers.append({"row": row.key, "run": run.name, **result.to_json()})
            if sentence := compared(ours, row.figures):
                words.append(f"{run.name}: {sentence}")
    units = [(name, quantity.unit) for name, quantity in MAIN[0].figures.items()]
    head = ("", "", *(f"{name}{'' if unit == '1' else f' [{unit}]'}" for name, unit in units))
    lines = [*_markdown(head, body), "", *(f"- {word}" for word in words)]
    return Section(title, lines, numbers, missing=missing)


def compared(ours: dict[str, Quantity], paper: dict[str, Quantity]) -> str:
    """Return the names of the figures that agree with the paper's, that disagree, and that the rides do not decide.

    A figure agrees if its 95 % interval lies within two standard deviations of the paper's mean. It disagrees if the
    two intervals do not meet. E_smth is left out: the paper gives no formula for it.
    """
    verdicts: dict[str, list[str]] = {"agree": [], "disagree": [], "not decided": []}
    for name, published in paper.items():
        own = ours[name]
        if not math.isfinite(own.value) or name == "E_smth":
            continue
        low, high = own.ci95
        least, most = max(0.0, published.value - 2 * published.std), published.value + 2 * published.std
        if name == "E_succ":
            most = min(1.0, most)
        if least <= low and high <= most:
            verdict = "agree"
        elif high < least or low > most:
            verdict = "disagree"
        else:
            verdict = "not decided"
        verdicts[verdict].append(name)
    return "; ".join(f"{verdict}: {', '.join(names)}" for verdict, names in verdicts.items() if names)


def _turned(result: Evaluation) -> str:
    """Return the achieved part of the turns that were asked for: the slope through the origin."""
    asked, done = result.headings[:, 0], result.headings[:, 1]
    return f"{asked @ done / (asked @ asked):.0%}" if len(asked) else "–"


def _of_rows(runs: Sequence[Run], rows: Sequence[str]) -> list[Run]:
    return [run for run in runs if run.row in rows and run.policy is not None]


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]
