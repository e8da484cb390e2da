"""The HUSKY paper's tables and figures, from trained policies.

python benchmarks/paper_tables.py [main|trajectories|curves|map|terrain|sensitivity ...] [--episodes 100] [--seeds 5]
"""

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from sysid.cli.console import Common, Output, Printer
from sysid.errors import SysidError

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Executor

    from paper.runs import Run

    from policy_runtime.evaluation.plain import Protocol
    from policy_runtime.evaluation.result import Evaluation
    from sysid.board import Board

Part = Literal["main", "trajectories", "headings", "curves", "map", "terrain", "sensitivity"]


def paper(
    *part: Part,
    runs: Path | None = None,
    episodes: int = 100,
    seeds: int = 5,
    workers: int | None = None,
    force: bool = False,
    output: Output | None = None,
    common: Common = Common(),
) -> int:
    """Make the paper's tables and figures, the paper's own figures beside ours; missing runs are listed.

    Args:
        part: What to make: main, trajectories, headings, curves, map, terrain, sensitivity; all if none is named. The map
            takes 36 times as many episodes as a row of a table.
        runs: Manifest of runs (TOML): which command made which weights; the shipped one if not given.
        episodes: Episodes of each seed for every policy and condition; the paper has 1000.
        seeds: Number of seeds: 0, 1, 2, …
        workers: Processes; as many as there are processors if not given.
        force: Ride where policy and board disagree.
        output: Folder for paper.md, paper.json and the pictures; reports/paper of the workspace if not given. What has
            been ridden is kept in its rides/, so that a run that was stopped goes on.
    """
    from joblib import Memory
    from paper.parts import PARTS
    from paper.runs import load_runs

    from policy_runtime.evaluation.plain import riders
    from sysid.cli.bars import bar
    from sysid.files import sha256, write_atomically, write_json

    if episodes < 1 or seeds < 1:
        raise SysidError(f"--episodes {episodes} --seeds {seeds}: both must be at least 1.")
    printer = Printer(common)
    manifest = load_runs(runs)
    folder = output or common.space.outputs("paper")
    processes = workers or len(os.sched_getaffinity(0))
    kept: Any = Memory(folder / "rides", verbose=0)
    ride = kept.cache(_ride, ignore=["policy", "pool", "progress"])
    with bar(printer) as progress, riders(processes) as pool:

        def measure(run: "Run", protocol: "Protocol") -> "Evaluation":
            assert run.policy is not None  # `parts` asks for runs that have one
            task = progress.add_task(run.name, total=episodes * seeds)
            found = ride(
                sha256(run.policy), str(run.policy), common.space.load_board(run.board), episodes, seeds, protocol,
                force, pool, partial(progress.advance, task),
            )  # fmt: skip
            progress.remove_task(task)
            return found

        sections = [PARTS[name](manifest, measure, folder) for name in part or PARTS]
    text = [
        "# The paper's tables and figures, made here",
        "",
        f"{episodes} episodes × {seeds} seed{'s' * (seeds > 1)} for every policy and condition, in plain MuJoCo, 20 s each; "
        "in brackets 95 % intervals. The paper's figures are mean ± standard deviation over its seeds, in its own simulator.",
        "",
        "A figure agrees if its interval lies within two standard deviations of the paper's mean. It disagrees if the two "
        "intervals do not meet. E_smth is not compared: the paper gives no formula. A run that starts from the weights of "
        "`pink` does not test the paper's ablation, because `pink` learned with the guidance.",
    ]
    for section in sections:
        text += ["", f"## {section.title}", "", *section.lines]
        if section.picture is not None:
            text += ["", f"![{section.title}]({section.picture})"]
        if section.missing:
            text += ["", "Missing, and how to train it:", "", *(f"- {row}" for row in section.missing)]
    text += ["", "## Runs", "", "The manifest of runs (`data/policies/runs.toml`) has their commands.", ""]
    text += ["| run | remark |", "|---|---|", *(f"| {run.name} | {run.note} |" for run in manifest), ""]
    write_atomically(folder / "paper.md", "\n".join(text))
    content = {section.title: {"rows": section.numbers, "missing": section.missing} for section in sections}
    content = {"episodes": episodes, "seeds": seeds, "sections": content}
    write_json(folder / "paper.json", content)
    for section in sections:
        printer.say(f"{section.title}: {len(section.missing)} missing" if section.missing else section.title)
    printer.say(f"written: {folder / 'paper.md'}")
    printer.result(content)
    return 0


def _ride(
    digest: str, policy: str, board: "Board", episodes: int, seeds: int, protocol: "Protocol", force: bool,
    pool: "Executor | None", progress: "Callable[[int], None]",
) -> "Evaluation":  # fmt: skip
    """Measure a policy; its file's digest stands for it where it is asked whether that has been done before."""
    from policy_runtime.evaluation.plain import evaluate_policy

    return evaluate_policy(
        policy, board, episodes=episodes, seeds=tuple(range(seeds)), protocol=protocol, pool=pool,
        force=force, progress=progress,
    )  # fmt: skip


def main() -> None:
    """Read the command line."""
    from cyclopts import run

    try:
        run(paper)
    except SysidError as error:
        raise SystemExit(f"error: {error}") from None


if __name__ == "__main__":
    main()
