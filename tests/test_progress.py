"""What is being done is told with the share of all of it, from wherever it is done; bars say how long it still takes."""

import numpy as np
from decay_truth import Recipe, make_roll

from sysid.board import load_board
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
