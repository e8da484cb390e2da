"""A log format and a kind of sensor are one file each, found by being there."""

from dataclasses import replace

import numpy as np
import pytest

import sysid.logs.sources as sources_package
from sysid.errors import SysidError
from sysid.fitting.records import signal_of
from sysid.logs import LogOptions, read_roll
from sysid.logs.formats.registry import formats
from sysid.logs.sources.registry import sources
from sysid.releases import find_releases

SOURCE = '''
"""Toy sensor: an angle that a potentiometer writes in volts, 1 V a radian."""

import numpy as np

from sysid.logs.sources.registry import Source
from sysid.logs.table.choose import Choice
from sysid.logs.table.remarks import note
from sysid.roll import Roll


def find(columns, axis, sign):
    volts = [column for column in columns if column.name.endswith("_V")]
    return [Choice(columns=(volts[0].name,), sign=sign, remarks=note("roll", "from a toy"))] if volts else []


def to_roll(reading):
    roll = reading.choice.sign * reading.signals[0]
    return Roll(
        log=reading.log, time=reading.time, roll=roll, std=np.full(len(roll), 1e-4), origin="toy", zero="drifting"
    )


SOURCE = Source(name="toy", order=9, quantity=None, find=find, to_roll=to_roll)
'''


@pytest.fixture
def decay():
    time = np.arange(0, 6, 0.002)
    swing = 0.2 * np.exp(-0.8 * (time - 1)) * np.cos(12 * (time - 1))
    return time, np.where(time < 1, 0.2, swing)


@pytest.fixture
def extended(tmp_path, monkeypatch):
    """Look for modules of a package in a folder as well, as if they lay in it."""

    def extend(package, text, cached):
        (tmp_path / "toy.py").write_text(text)
        monkeypatch.setattr(package, "__path__", [*package.__path__, str(tmp_path)])
        monkeypatch.delitem(__import__("sys").modules, f"{package.__name__}.toy", raising=False)
        cached.cache_clear()

    yield extend
    monkeypatch.undo()
    formats.cache_clear()
    sources.cache_clear()


def test_a_kind_of_sensor_is_one_file(extended, decay, tmp_path):
    log = tmp_path / "swing.csv"
    np.savetxt(log, np.column_stack(decay), delimiter=",", header="time_s,pot_V", comments="")
    assert any("'pot_V' is the only column that moves" in text for text in read_roll(log).warnings)
    extended(sources_package, SOURCE, sources)
    roll = read_roll(log, LogOptions(source="toy"))
    np.testing.assert_allclose(roll.roll, decay[1], atol=1e-12)
    assert signal_of(find_releases(roll)) == {"use_rate": False, "bias": "per-release"}
    rated = [replace(r, rate=np.gradient(r.roll, r.time)) for r in find_releases(roll)]
    assert signal_of(rated) == {"use_rate": True, "bias": "per-release"}
    with pytest.raises(SysidError, match="accelerometer, position, toy"):
        read_roll(log, LogOptions(source="pot"))
