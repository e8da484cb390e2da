"""What mujoco.sysid and pysindy say of the logs of the hidden-effect suite, beside what `diagnose` said.

Run:  pip install "mujoco[sysid]" pysindy colorama
      python benchmarks/hidden_effects.py --rows rows.jsonl
      python benchmarks/hidden_effects_peers.py rows.jsonl

Each peer gets the very releases. mujoco.sysid fits stiffness and damping from the record's values, each release
from its first sample at rate zero (it cannot fit the start), and its own report's insights are what it says.
pysindy looks for v̇ among nine terms in weak form (derivatives by integration, kind to noise), by sequentially
thresholded least squares on columns of unit length; its one threshold was set beforehand to the share of the
spring's torque at which an effect of this suite begins, 2 %, and not chosen per case.
"""

import contextlib
import io
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
from hidden_effects import said_in
from hidden_truths import TRUTHS, Truth, board_of, make
from mujoco_sysid import fit_hinge, hinge
from pages import table, write_result
from suite import Row

from sysid.board import Board
from sysid.roll import Release

SHOWN = (
    "none", "none, heavy", "coulomb 0.1", "coulomb 0.15, heavy", "quadratic-damping 0.03", "cubic-damping 0.015",
    "cubic-stiffness 250", "asymmetric-stiffness -25", "end-stop 0.13,100", "freeplay 0.02", "viscoelastic 3,0.06",
    "hysteresis 6,0.15", "coulomb and cubic-stiffness", "cogging", "damper on one side",
)  # fmt: skip
TERMS = {
    "x": None, "v": None, "1": "offset", "x²": "asymmetric-stiffness", "x³": "cubic-stiffness",
    "v|v|": "quadratic-damping", "v³": "cubic-damping", "sign v": "coulomb", "x|x|": "x times its size",
}  # fmt: skip
"""pysindy's library, and the effect of the catalogue that each term is."""
THRESHOLD = 0.02
PEERS = ("husky-sysid `diagnose`", "mujoco.sysid report", "pysindy, weak form: terms kept beside k and d")
"""Heads of the columns."""


def ask_mujoco_sysid(releases: Sequence[Release], board: Board) -> str:
    """Return the titles of mujoco.sysid's insights, and the residual over the noise that it does not mention."""
    from mujoco.sysid.report.sections.insights import AutomatedInsights

    step = float(np.median(np.diff(releases[0].time)))
    spec = hinge(board.inertia.value, board.stiffness, board.damping, step)
    logs = [(step * np.arange(len(r.time)), r.roll, float(r.roll[0])) for r in releases]
    found = fit_hinge(spec, {"stiffness": (1e-3, 200.0), "damping": (1e-3, 5.0)}, logs, "scipy")
    return "; ".join(insight["title"] for insight in AutomatedInsights("Log", found)._insights)


def ask_pysindy(releases: Sequence[Release], board: Board) -> set[str]:
    """Return the effects whose terms pysindy keeps."""
    import pysindy
    from scipy.signal import savgol_filter

    step = float(np.median(np.diff(releases[0].time)))
    frequency = np.sqrt(board.stiffness / board.inertia.value)
    width = max(7, int(2 * np.pi / frequency / 6 / step) | 1)
    count = min(len(r.time) for r in releases)
    states = []
    for release in releases:
        roll = release.roll[:count] - release.rest
        rate = savgol_filter(roll, width, 4, deriv=1, delta=step)
        states.append(np.column_stack([savgol_filter(roll, width, 4), rate / frequency]))
    functions = [
        lambda x, v: x, lambda x, v: v, lambda x, v: 0 * x + 0.1, lambda x, v: x * x / 0.2, lambda x, v: x**3 / 0.04,
        lambda x, v: v * np.abs(v) / 0.2, lambda x, v: v**3 / 0.04, lambda x, v: 0.1 * np.sign(v), lambda x, v: x * np.abs(x) / 0.2,
    ]  # fmt: skip
    library = pysindy.WeakPDELibrary(
        function_library=pysindy.CustomLibrary(library_functions=functions),
        spatiotemporal_grid=step * frequency * np.arange(count),
        K=400,
    )
    model = pysindy.SINDy(optimizer=pysindy.STLSQ(threshold=THRESHOLD), feature_library=library)
    with contextlib.redirect_stdout(io.StringIO()):
        model.fit(states, t=step * frequency)
    kept = np.abs(model.coefficients()[1]) > 0
    return {name for name, used in zip(TERMS.values(), kept, strict=True) if used and name}


def row(truth: Truth, ours: Row) -> tuple[str, ...]:
    """Return one row of the table."""
    with TemporaryDirectory() as folder:
        releases = make(truth, ours["seed"], Path(folder))
    board = board_of(truth)
    try:
        sindy = " + ".join(sorted(ask_pysindy(releases, board))) or "nothing"
    except ValueError as error:
        sindy = f"(fails: {error})"
    return truth.name, said_in(ours), ask_mujoco_sysid(releases, board), sindy


def main() -> None:
    rows = [json.loads(line) for line in Path(sys.argv[1]).read_text().splitlines()]
    cells: list[tuple[str, ...]] = []
    for name in SHOWN:
        ours = next((r for r in rows if r["truth"] == name), None)
        if ours is not None:
            cells.append(row(next(t for t in TRUTHS if t.name == name), ours))
            print(*cells[-1], sep=" | ", flush=True)
    write_result(
        "hidden_effects_peers.md",
        "# What peers say of the same logs\n\n"
        f"Made by `benchmarks/hidden_effects_peers.py`; MuJoCo {mujoco.__version__}; one seed each, the same releases for all.\n\n"
        + table(("hidden", *PEERS), cells),
    )


if __name__ == "__main__":
    main()
