"""A phone is read by its own protocol, keeps its log as its app exports it, and says what is wrong."""

import numpy as np
import pytest
from command_line import husky
from recorded_phone import recorded_phone

from sysid.errors import SysidError
from sysid.live.phyphox import Phone
from sysid.logs import read_roll


@pytest.fixture(scope="module")
def export(tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "tip.zip"
    husky("synth", "-b", "pink", "--releases", "2", "--rate", "200", "--dialect", "phyphox", "-o", path)
    return path


def test_every_sample_is_kept_once_and_reads_as_the_export_does(export, tmp_path):
    with recorded_phone(export, pace=100) as (served, address):
        phone = Phone(address, tmp_path / "log")
        phone.connect()
        while served.now < 8.0:
            phone.poll()
        phone.poll()
        assert len(phone.poll()) == 0
    kept, whole = read_roll(tmp_path / "log"), read_roll(export)
    assert np.array_equal(kept.time, whole.time)
    assert np.allclose(kept.roll, whole.roll, atol=1e-6)
    assert served.asked[:2] == ["/config", "/control?cmd=start"]
    assert any("gyrX=" in path and "|gyr_time" in path for path in served.asked)


def test_a_phone_without_an_accelerometer_is_read_by_its_gyroscope(export, tmp_path):
    with recorded_phone(export, pace=100, without=("accX",)) as (_, address):
        phone = Phone(address, tmp_path / "log")
        phone.connect()
        phone.poll()
    assert [path.name for path in (tmp_path / "log").iterdir()] == ["Gyroscope.csv"]


def test_an_experiment_without_a_gyroscope_is_refused_by_what_it_has(export, tmp_path):
    with recorded_phone(export, without=("gyrX",)) as (_, address), pytest.raises(SysidError, match="accX"):
        Phone(address, tmp_path / "log").connect()


def test_nobody_there_is_said_with_what_to_do(tmp_path):
    with pytest.raises(SysidError, match="allow remote access"):
        Phone("127.0.0.1:9", tmp_path / "log").connect()


def test_a_row_that_has_not_arrived_whole_comes_with_the_next_answer(export, tmp_path):
    with recorded_phone(export, pace=100) as (served, address):
        phone = Phone(address, tmp_path / "log")
        phone.connect()
        whole = served.answer

        def torn(path):
            answer = whole(path)
            for name in ("gyrZ", "accZ"):
                if name in answer.get("buffer", {}):
                    answer["buffer"][name]["buffer"] = answer["buffer"][name]["buffer"][:-3]
            return answer

        served.answer = torn
        phone.poll()
        served.answer = whole
        while served.now < 8.0:
            phone.poll()
        phone.poll()
    assert len(read_roll(tmp_path / "log").time) == len(read_roll(export).time)
