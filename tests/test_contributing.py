"""CONTRIBUTING.md: its toys work as printed, every package has a row, and folders of tests mirror the packages."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

import sim.check.rules
import sysid
from sysid import effects
from sysid.effects import _own
from sysid.logs.formats import registry
from sysid.synth import SynthOptions, synthesise

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
TOYS = {
    Path(toy["path"]).name: toy["code"]
    for toy in re.finditer(r"^<!-- toy: (?P<path>\S+) -->\n```python\n(?P<code>.*?)^```", TEXT, re.M | re.S)
}


def written(name, folder):
    path = folder / name
    path.write_text(TOYS[name])
    return path


def module(name, folder):
    spec = importlib.util.spec_from_file_location(Path(name).stem, written(name, folder))
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


@pytest.fixture
def no_own_effects(monkeypatch):
    monkeypatch.setenv(_own.FILES, "")
    effects.catalogue.cache_clear()
    yield
    monkeypatch.undo()
    effects.catalogue.cache_clear()


@pytest.mark.usefixtures("no_own_effects")
def test_a_toy_effect(tmp_path):
    name = effects.use_file(written("quartic.py", tmp_path))
    assert name == "quartic-stiffness"
    pink = sysid.Joint.load("pink")
    made = synthesise(pink, {name: (4000.0,)}, SynthOptions(angles=(0.25, -0.2, 0.15), rate=400.0))
    log = sysid.Recording.from_arrays(made.time, angle=made.channels[:, 0])
    found = sysid.fit(log, pink, [name]).quantities[f"{name}.coefficient"]
    assert abs(found.value - 4000.0) < 2 * (found.ci95[1] - found.value)
    assert found.ci95[0] > 0


def test_a_toy_log_format(tmp_path, monkeypatch):
    toy = module("swing.py", tmp_path).FORMAT
    known = registry.formats()
    monkeypatch.setattr(registry, "formats", lambda: tuple(sorted((toy, *known), key=lambda one: one.order)))
    made = synthesise(sysid.Joint.load("pink"), options=SynthOptions(angles=(0.17, -0.15), rate=400.0))
    lines = (
        f"{1e3 * t:.3f} {np.degrees(a):.5f}" for t, a in zip(made.time, made.channels[:, 0], strict=True)
    )
    path = tmp_path / "tip.swing"
    path.write_text("SWING1\n" + "\n".join(lines))
    recording = sysid.Recording.read(path)
    assert len(recording.releases) == 2
    assert np.allclose(recording.roll.roll, made.channels[:, 0], atol=1e-6)


@pytest.mark.parametrize(("timestep", "speaks"), [(0.02, True), (0.002, False)])
def test_a_toy_rule(tmp_path, monkeypatch, timestep, speaks):
    module("coarse_step.py", tmp_path)
    monkeypatch.setattr(sim.check.rules, "__path__", [*sim.check.rules.__path__, str(tmp_path)])
    rig = sysid.Joint.load("pink")
    made = synthesise(rig, options=SynthOptions(angles=(0.17, -0.15), rate=400.0))
    log = sysid.Recording.from_arrays(made.time, angle=made.channels[:, 0])
    warnings = rig.check(log, timestep=timestep).warnings
    assert any("choose a smaller --timestep" in text for text in warnings) == speaks


PACKAGES = ("sysid", "sim", "policy_runtime", "reports")
OF_THEMSELVES = {"support", "data"}
"""Folders of tests that belong to no package."""


def packages():
    files = (path for package in PACKAGES for path in (ROOT / package).rglob("__init__.py"))
    return {path.parent.relative_to(ROOT).as_posix() for path in files}


def test_every_package_has_its_row():
    rows = re.findall(r"^\| `([\w/]+)/` \|", TEXT, re.M)
    assert len(rows) == len(set(rows))
    assert set(rows) == packages() | {"data"}


def test_tests_mirror_the_packages():
    folders = {
        path.parent.relative_to(ROOT / "tests").as_posix() for path in (ROOT / "tests").rglob("test_*.py")
    }
    places = {package.removeprefix("sysid/") for package in packages()} | OF_THEMSELVES | {"."}
    assert folders <= places
