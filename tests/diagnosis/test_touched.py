"""A release that no law shares with the others is left out; a board that changed is not."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.board import load_board
from sysid.diagnosis.search import Search
from sysid.diagnosis.touched import touched_release
from sysid.fitting.records import make_records
from sysid.fitting.search import scales_of
from sysid.joint import JointLaw, simulate
from sysid.roll import Release
from sysid.workspace import shipped_data

NOISE = 1e-3
TIME = np.arange(0.0, 1.0, 5e-3)
LAW = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.05)


def decay(angle, law=LAW):
    return simulate(law, TIME, angle).roll


def caught(angle):
    """A hand takes it in the third swing, and brings it aside."""
    return np.where(TIME < 0.4, decay(angle), 0.05 * np.minimum((TIME - 0.4) / 0.3, 1.0))


def touched(*rolls):
    rng = np.random.default_rng(3)
    releases = [
        Release(
            log="x", number=n, time=TIME, roll=roll + NOISE * rng.standard_normal(len(TIME)), rest=0.0, hold=1.0,
            std=np.full(len(TIME), NOISE), origin="angle", end="log",
        )
        for n, roll in enumerate(rolls, start=1)
    ]  # fmt: skip
    board = load_board(shipped_data() / "boards" / "pink.toml")
    records = make_records(releases, NOISE, rate=False)
    search = Search(records=records, scales=scales_of(records, board), bias="shared")
    return touched_release([search.single(()), search.single(("coulomb",))], ())


FREE, WIDE = decay(-0.14), decay(0.17)
STIFFER = decay(0.12, replace(LAW, stiffness=18.0))


@pytest.mark.parametrize(
    ("rolls", "odd"),
    [
        ((WIDE, caught(0.12), FREE), 1),
        ((WIDE, FREE, decay(0.1)), None),
        ((WIDE, FREE, STIFFER), None),
        ((WIDE, caught(0.12)), None),
    ],
    ids=["a hand in one of three", "all free", "a spring that changed", "one against one"],
)
def test_what_is_by_no_law_beside_others_that_agree(rolls, odd):
    assert touched(*rolls) == odd
