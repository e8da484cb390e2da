"""What mujoco.sysid, pysindy and `diagnose` say of logs that nobody here made.

Run:  pip install "mujoco[sysid]" pysindy colorama
      python benchmarks/foreign_logs.py ../shared/foreign_logs > verdicts.txt
      python benchmarks/foreign_peers.py ../shared/foreign_logs verdicts.txt

Each gets the releases that `find_releases` cuts; how the peers are asked stands in `hidden_effects_peers.py`. Both want even
steps, so what jitters or lacks rows is interpolated for them. A peer that is not installed is a column that says so.
"""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from foreign_logs import kinds
from hidden_effects_peers import PEERS, ask_mujoco_sysid, ask_pysindy
from pages import table, write_result
from suite import command_line

from sysid.board import Board, load_board
from sysid.logs import read_roll
from sysid.releases import find_releases
from sysid.roll import Release

ROOT = Path(__file__).parents[1]


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
