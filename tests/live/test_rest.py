"""Numbers come within a second of the end of a release, by the phone's own clock: seconds of a busy machine say nothing."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from command_line import husky
from recorded_phone import recorded_phone
from scipy.signal import savgol_filter

from sysid.board import load_board
from sysid.errors import SysidError
from sysid.live.phyphox import Phone
from sysid.live.rest import REST_TIMES, Rest
from sysid.live.session import Session
from sysid.recording import Recording
from sysid.workspace import shipped_data

DROPS = Path(__file__).parents[3] / "shared" / "real_logs" / "servo_passive_drop"
EVERY = 0.2


def shown(export, folder, board, count):
    """When each of some releases had its numbers, and how often the log was read [s of the phone]."""
    session, rest, times, reads = Session(board, grows=True), Rest(), [], 0
    with recorded_phone(export, step=EVERY) as (served, address):
        phone = Phone(address, folder)
        phone.connect()
        while len(session.releases) < count and served.now < 60:
            if not rest.has_come(phone.poll()):
                continue
            reads += 1
            try:
                ended = session.take([Recording.read(folder)])
            except SysidError:  # nothing was let go yet
                continue
            times += [served.now] if ended else []
    return times, reads


def test_numbers_come_within_a_second_and_the_log_is_seldom_read(tmp_path):
    husky(
        "synth", "-b", "pink", "--releases", "2", "--rate", "200", "--dialect", "phyphox", "-o", tmp_path / "a.zip"
    )  # fmt: skip
    pink = load_board(shipped_data() / "boards" / "pink.toml")
    times, reads = shown(tmp_path / "a.zip", tmp_path / "log", pink, 2)
    ends = (2.06, 5.16)  # the deck is still then: releases at 1.7 and 4.8 s
    assert all(0 < seen - end < 1.0 for seen, end in zip(times, ends, strict=True))
    assert reads <= 5 * len(REST_TIMES)  # where it begins, is tilted, held, let go, tilted again


@pytest.mark.skipif(not DROPS.is_dir(), reason="the real drops of a servo are not here")
def test_real_drops_in_a_phones_form_give_numbers_within_a_second(tmp_path):
    """A servo's arm falls as it fell; a phone on it would have read the rate and gravity's direction."""
    tables = [np.loadtxt(DROPS / f"drop_kp{gain}.csv", delimiter=",", skiprows=1) for gain in (800, 400)]
    begins = np.cumsum([0.0] + [table[-1, 0] + 0.02 for table in tables])
    time = np.arange(0.01, begins[-1] - 0.02, 0.005)
    angle = np.interp(
        time, np.concatenate([t + table[:, 0] for t, table in zip(begins, tables, strict=False)]),
        np.concatenate([table[:, 1] for table in tables]),
    )  # fmt: skip
    angle, rate = (savgol_filter(angle, 15, 2, deriv=order, delta=0.005) for order in (0, 1))
    zero, rng = np.zeros_like(time), np.random.default_rng(0)
    columns = {
        "Gyroscope": (rate, zero, zero),
        "Accelerometer": (zero, 9.81 * np.sin(angle), 9.81 * np.cos(angle)),
    }
    with zipfile.ZipFile(tmp_path / "drop.zip", "w") as archive:
        for name, axes in columns.items():
            rows = np.column_stack([time, *(axis + 0.005 * rng.standard_normal(len(time)) for axis in axes)])
            text = io.StringIO()
            np.savetxt(text, rows, "%.9E", ",", header='"Time (s)",x,y,z', comments="")
            archive.writestr(f"{name}.csv", text.getvalue())
    husky("new", "servo", "--kind", "pendulum", "--mass", "0.49", "--arm", "0.1", "--workspace", tmp_path)
    servo = load_board(tmp_path / "data" / "boards" / "servo.toml")
    times, _ = shown(tmp_path / "drop.zip", tmp_path / "log", servo, 2)
    for number, (seen, begin) in enumerate(zip(times, begins[:2], strict=True)):
        # Where one drop is joined to the next, the arm jumps back.
        inside = (time > begin) & (time < begin + tables[number][-1, 0] - 0.1)
        still = time[inside][np.flatnonzero(np.abs(rate[inside]) > 0.06)[-1]]
        assert 0 < seen - still < 1.0
