"""The shipped synthetic logs: made by their recipes, small, within the boards' range, with their truth."""

import json
import runpy
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sysid.workspace import Workspace, shipped_data

DECAYS = shipped_data() / "decays"


RECIPES = runpy.run_path(str(DECAYS / "make_decays.py"))


@pytest.mark.parametrize("name", RECIPES["RECIPES"])
def test_shipped_log_is_what_its_recipe_makes(tmp_path: Path, name: str) -> None:
    RECIPES["make"](name, tmp_path)
    shipped, fresh = pd.read_csv(DECAYS / name), pd.read_csv(tmp_path / name)
    assert list(shipped.columns) == list(fresh.columns)
    # Another processor or library version may round the last digits differently.
    assert np.abs(shipped.to_numpy() - fresh.to_numpy()).max() < 2e-5
    truth = Path(name).with_suffix(".truth.json")
    shipped_truth, fresh_truth = (json.loads((folder / truth).read_text()) for folder in (DECAYS, tmp_path))
    for old, new in zip(shipped_truth["releases"], fresh_truth["releases"], strict=True):
        assert old == pytest.approx(new, abs=1e-7)
    for key in ("parameters", "effects", "seed", "samples", "board", "command", "sensor"):
        assert shipped_truth[key] == fresh_truth[key]


def test_every_log_has_a_recipe_and_a_truth() -> None:
    logs = {path.name for path in DECAYS.glob("*.csv")}
    assert logs == set(RECIPES["RECIPES"])
    assert {path.name for path in DECAYS.glob("*.truth.json")} == {f"{Path(n).stem}.truth.json" for n in logs}
    readme = (DECAYS / "README.md").read_text()
    assert "synthetic" in readme
    assert all(f"`{name}`" in readme for name in logs)


def test_logs_are_small_and_within_the_range_of_their_board() -> None:
    assert max(path.stat().st_size for path in DECAYS.iterdir() if path.is_file()) < 300_000
    assert sum(path.stat().st_size for path in DECAYS.iterdir() if path.is_file()) < 1_500_000
    for path in DECAYS.glob("*.truth.json"):
        truth = json.loads(path.read_text())
        limit = Workspace(DECAYS).load_board(truth["board"]).tilt["range"].value
        assert all(abs(release["angle_rad"]) < limit for release in truth["releases"])
        assert {release["angle_rad"] > 0 for release in truth["releases"]} == {True, False}
