"""The paper's tables and figures: what is measured for them, and what they say of what is not there."""

import json
from pathlib import Path

import numpy as np
import pytest
from paper.parts import PARTS, compared
from paper.published import MAIN, SENSITIVITY
from paper.runs import Run
from paper_tables import paper
from riding import pink, world_or_skip

from policy_runtime.evaluation.plain import Protocol, evaluate_policy
from sysid.cli import build_app
from sysid.quantity import Quantity
from sysid.text import in_brackets as text

pytestmark = pytest.mark.train

HUSKY = Run(name="mine", row="husky", board="pink", command="husky-sysid train", policy=Path("zero"))


@pytest.fixture(scope="module")
def result():
    world_or_skip()
    return evaluate_policy(
        "zero", pink(), episodes=2, seeds=(0,), protocol=Protocol(duration=0.2, speed=(1, 1))
    )


@pytest.fixture
def measured(result):
    """What was asked to be measured; every answer is the same."""
    asked = []

    def measure(run, protocol):
        asked.append((run.name, protocol))
        return result

    return asked, measure


def test_main_table_has_every_row_and_says_what_is_missing(measured, tmp_path):
    asked, measure = measured
    section = PARTS["main"]([HUSKY], measure, tmp_path)
    assert [name for name, _ in asked] == ["mine"]
    lines = "\n".join(section.lines)
    for row in MAIN:
        assert row.title in lines
    assert "| HUSKY | paper | 1.000 ± 0.000 | 0.056 ± 0.013 |" in lines
    assert "| HUSKY | mine on pink | 1.000 [0.342, 1.000] |" in lines
    assert len(section.missing) == len(MAIN) - 1
    assert "pushing by tracking: husky-sysid train --set pushing=tracking" in section.missing


def test_options_of_every_row_are_options_of_the_training():
    for row in (*MAIN, *SENSITIVITY):
        build_app().parse_args(
            ["train", "--board", "pink", *row.options.split()], exit_on_error=False, print_error=False
        )


def test_figures_are_compared_by_both_intervals():
    paper = {"E_vel": Quantity(0.056, 0.013, "m/s", "paper"), "E_yaw": Quantity(0.208, 0.014, "rad", "paper")}
    ours = {
        "E_vel": Quantity(0.11, 0.005, "m/s", "ours", (0.10, 0.12)),
        "E_yaw": Quantity(0.22, 0.005, "rad", "ours", (0.21, 0.23)),
    }
    assert compared(ours, paper) == "agree: E_yaw; disagree: E_vel"
    few = ours | {"E_vel": Quantity(0.08, 0.01, "m/s", "ours", (0.06, 0.10)), "E_smth": ours["E_vel"]}
    assert compared(few, paper | {"E_smth": paper["E_vel"]}) == "agree: E_yaw; not decided: E_vel"
    assert compared(ours, {}) == ""
    assert text(ours["E_vel"]) == "0.110 [0.100, 0.120]"
    assert text(Quantity(float("nan"), float("nan"), "1", "")) == "–"


def test_command_writes_page_and_numbers(tmp_path, capsys):
    (tmp_path / "curves.csv").write_text(
        "iteration,samples,survival,speed_error,heading_error,both_feet\n1,96,0,1,1,0\n2,192,0.5,0.4,0.3,0.9\n"
    )
    manifest = tmp_path / "runs.toml"
    manifest.write_text(
        "[[run]]\nname='a'\nboard='pink'\ncommand='husky-sysid train'\nnote='from rest'\ncurves='curves.csv'"
    )
    assert paper("main", "curves", runs=manifest, output=tmp_path / "out") == 0
    page = (tmp_path / "out" / "paper.md").read_text()
    assert "## Main table" in page
    assert "![Learning curves, and where they end](curves.png)" in page
    assert "| a | from rest |" in page
    content = json.loads((tmp_path / "out" / "paper.json").read_text())
    assert len(content["sections"]["Main table"]["missing"]) == len(MAIN)
    assert np.isclose(
        content["sections"]["Learning curves, and where they end"]["rows"]["a"]["survival"], 0.5
    )
