"""What mujoco.sysid, pysindy and `diagnose` say of logs that nobody here made.

Run:  pip install "mujoco[sysid]" pysindy colorama
      python benchmarks/foreign_logs.py ../shared/foreign_logs > verdicts.txt
      python benchmarks/foreign_peers.py ../shared/foreign_logs verdicts.txt

Each gets the releases that `find_releases` cuts. Both peers want even steps, so logs with jitter or gaps are interpolated for
them. A peer that is not installed is a column that says so.

mujoco.sysid fits stiffness and damping from the record's values, each release from its first sample at rate zero (it cannot fit
the start). Its own report's insights are its answer. pysindy looks for v̇ among nine terms in weak form, by sequentially
thresholded least squares on columns of unit length. Its threshold is 2 % of the spring's torque, set beforehand.
"""

import contextlib
import io
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from foreign_logs import kinds
from mujoco_sysid import fit_hinge, hinge
from pages import table, write_result
from suite import command_line

from sysid.board import Board, load_board
from sysid.logs import read_roll
from sysid.releases import find_releases
from sysid.roll import Release

ROOT = Path(__file__).parents[1]
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


def even(release: Release) -> Release:
    """Return a release on even steps."""
    time = np.arange(release.time[0], release.time[-1], float(np.median(np.diff(release.time))))
    return replace(
        release,
        time=time,
        roll=np.interp(time, release.time, release.roll),
        std=np.full(len(time), release.std[0]),
    )


def asked(
    ask: Callable[[Sequence[Release], Board], str | set[str]], releases: Sequence[Release], board: Board
) -> str:
    """Return what a peer says, or why it says nothing."""
    try:
        said = ask(releases, board)
    except ImportError as error:
        return f"(not installed: {error.name})"
    except Exception as error:  # noqa: BLE001 - what a peer cannot do belongs into the table
        return f"(fails: {type(error).__name__}: {error})"
    return said if isinstance(said, str) else " + ".join(sorted(said)) or "nothing"


def our_verdicts(text: str) -> dict[str, tuple[str, bool]]:
    """Return what `foreign_logs.py` printed of each log: the verdict, and whether it is right."""
    found: dict[str, tuple[str, bool]] = {}
    for line in text.splitlines():
        if line.startswith(("ok ", "BAD ")) and " | confidence " in line:
            name, confidence = line.split()[1], float(line.split(" | confidence ")[1].split()[0])
            said = line.split(" | confidence ")[0][64:].strip()
            found[name] = f"{said} ({confidence:.0%})", line.startswith("ok ")
    return found


def row(folder: Path, name: str, truth: dict[str, list], ours: str) -> tuple[str, bool, bool]:
    """Return a line of the table, whether pysindy's families are right, and whether the right ones are among them."""
    board = load_board(ROOT / "data/boards/pink.toml")
    releases = [even(release) for release in find_releases(read_roll(folder / f"{name}.csv"))]
    wanted = {kinds(group) for group in (truth["effects"], *truth["also"])}
    sindy = asked(ask_pysindy, releases, board)
    terms = () if sindy == "nothing" else tuple(sindy.split(" + "))
    named = kinds(terms)
    among = any(group and group < named for group in wanted)
    peer = asked(ask_mujoco_sysid, releases, board)
    cells = (name, " + ".join(truth["effects"]) or "nothing", ours, peer, sindy)
    return table(cells, ()).splitlines()[0], named in wanted, among


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("verdicts", type=Path, help="what foreign_logs.py printed")
    parser.add_argument("--out", default="foreign_peers.md", help="in results/")
    options = parser.parse_args()
    if not (options.folder / "truth.json").exists():
        print(f"{options.folder}: no truth.json, nothing to run")
        sys.exit(0)
    truths = json.loads((options.folder / "truth.json").read_text())
    ours = our_verdicts(options.verdicts.read_text())
    rows = [
        row(options.folder, name, truths[name], ours.get(name, ("(not asked)", False))[0]) for name in truths
    ]
    head = ("log", "hidden", *PEERS)
    write_result(
        options.out,
        "# What peers say of logs that nobody here made\n\n"
        "Made by `benchmarks/foreign_peers.py`; the same releases for all, even steps for the peers.\n\n"
        f"Families right: husky-sysid {sum(right for _, right in ours.values())} of {len(ours)}, pysindy "
        f"{sum(right for _, right, _ in rows)} of {len(rows)} (in {sum(among for _, _, among in rows)} more they are among those "
        "that it names); mujoco.sysid names none: it warns of bounds.\n\n"
        + table(head, ())
        + "\n"
        + "\n".join(line for line, _, _ in rows),
    )


if __name__ == "__main__":
    main()
