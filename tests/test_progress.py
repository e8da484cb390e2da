"""What is being done is told with the share of all of it, from wherever it is done; bars say how long it still takes."""

import io

import numpy as np
import pytest
from decay_truth import Recipe, make_roll
from rich.console import Console

from sysid.board import load_board
from sysid.cli.bars import TimeLeft
from sysid.comparison.compare import compare
from sysid.fit_mjcf import fit
from sysid.progress import listening, stage, steps
from sysid.recording import Recording
from sysid.workspace import shipped_data


def told(work):
    heard = []
    with listening(lambda name, share: heard.append((name, share))):
        work()
    return heard


def test_steps_within_a_stage_are_shares_of_the_whole():
    def work():
        with stage(0.0, 0.5, "first"):
            for _ in steps(range(2)):
                pass
        with stage(0.5, 1.0, "second"):
            for part in steps("ab", lambda letter: f"at {letter}"):
                if part == "a":
                    assert list(steps([7, 8])) == [7, 8]

    assert told(work) == [
        ("first", 0.0), ("first", 0.0), ("first", 0.25),
        ("second", 0.5), ("at a", 0.5), ("at a", 0.5), ("at a", 0.625), ("at b", 0.75),
    ]  # fmt: skip


def test_what_is_left_early_leaves_the_stage_as_it_was():
    def work():
        with stage(0.0, 0.5, "first"):
            for _ in steps(range(4)):
                break
        with pytest.raises(ZeroDivisionError), stage(0.5, 1.0, "second"):
            for _ in steps(range(2)):
                _ = 1 / 0
        with stage(0.9, 1.0, "third"):
            pass

    assert told(work)[-1] == ("third", 0.9)


def test_nobody_listens_and_nothing_is_wrapped():
    parts = [1, 2]
    assert steps(parts) is parts


def test_fit_and_compare_tell_how_far_they_are():
    board = load_board(shipped_data() / "boards" / "pink.toml")
    recorded = Recording.of(make_roll(Recipe(amplitudes=(0.2, -0.15), sampling=200, noise=3e-4)))

    def whole():
        with stage(0.0, 0.5, "fitting"):
            found = fit(recorded, board, ["coulomb"])
        with stage(0.5, 0.8, "simpler models"):
            found.report()
        with stage(0.8, 1.0, "comparing"):
            compare(recorded, board)

    heard = told(whole)
    shares = [share for _, share in heard]
    assert shares == sorted(shares)
    assert len(set(shares)) > 10
    assert max(np.diff(shares)) < 0.3
    assert {name for name, _ in heard} >= {"fitting", "spring and damper", "comparing"}


def test_the_time_left_runs_down_between_updates():
    from rich.progress import Progress

    now = [0.0]
    shown = Progress(TimeLeft(), console=Console(file=io.StringIO()), get_time=lambda: now[0])
    shown.add_task("", total=1.0)
    (task,) = shown.tasks
    column = TimeLeft()

    def at(time, share):
        now[0] = time
        shown.update(task.id, completed=share)
        return column.render(task).plain

    assert at(2.0, 0.0) == "2 s so far"
    assert at(10.0, 0.25) == "30 s left"
    assert at(25.0, 0.25) == "15 s left"
    assert at(45.0, 0.25) == "soon"
    assert at(50.0, 0.5) == "50 s left"
    assert at(1000.0, 0.5) == "soon"
    assert at(1001.0, 0.6) == "11 min left"
