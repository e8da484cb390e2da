"""A phone is read by its own protocol, keeps its log as its app exports it, and says what is wrong."""

import json
import socket
import threading
import time
from contextlib import contextmanager, suppress

import numpy as np
import pytest
from recorded_phone import export_of_two_releases, recorded_phone

from sysid.errors import SysidError
from sysid.live.phyphox import PATIENCE, Phone
from sysid.logs import read_roll


@pytest.fixture(scope="module")
def export(tmp_path_factory):
    return export_of_two_releases(tmp_path_factory.mktemp("export"))


@contextmanager
def connected(export, tmp_path):
    with recorded_phone(export, pace=100) as (served, address):
        phone = Phone(address, tmp_path / "log")
        phone.connect()
        yield served, phone


def poll_all(served, phone):
    while served.now < 8.0:
        phone.poll()
    phone.poll()


def test_every_sample_is_kept_once_and_reads_as_the_export_does(export, tmp_path):
    with connected(export, tmp_path) as (served, phone):
        poll_all(served, phone)
        assert len(phone.poll()) == 0
    kept, whole = read_roll(tmp_path / "log"), read_roll(export)
    assert np.array_equal(kept.time, whole.time)
    assert np.allclose(kept.roll, whole.roll, atol=1e-6)
    assert served.asked[:2] == ["/config", "/control?cmd=start"]
    assert any("gyrX=" in path and "|gyr_time" in path for path in served.asked)


def test_an_experiment_without_a_gyroscope_is_refused_by_what_it_has(export, tmp_path):
    with recorded_phone(export, without=("gyrX",)) as (_, address), pytest.raises(SysidError, match="accX"):
        Phone(address, tmp_path / "log").connect()


def test_a_row_that_has_not_arrived_whole_comes_with_the_next_answer(export, tmp_path):
    with connected(export, tmp_path) as (served, phone):
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
        poll_all(served, phone)
    assert len(read_roll(tmp_path / "log").time) == len(read_roll(export).time)


@contextmanager
def answering(body, *, drip=False):
    """Serve one answer to every question, byte by byte if it shall `drip`; yield its address."""
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(0.1)
    ended = threading.Event()

    def serve():
        while not ended.is_set():
            with suppress(OSError):
                connection = server.accept()[0]
                connection.settimeout(5.0)
                with connection:
                    connection.recv(4096)
                    for part in (body[n : n + 1] for n in range(len(body))) if drip else (body,):
                        connection.sendall(part)
                        time.sleep(0.2 if drip else 0.0)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield f"127.0.0.1:{server.getsockname()[1]}"
    finally:
        ended.set()
        thread.join()
        server.close()


def http(content):
    return b"HTTP/1.1 200 OK\r\n\r\n" + content


@pytest.mark.parametrize(
    "body",
    [
        b"", b"junk\r\n\r\n", b"HTTP/1.1 abc\r\n\r\n", http(b"[" * 200_000), http(b'{"buffers": 5}'), http(b'{"buffers": [null, "a"]}'),
        http(b'{"buffers": [{"name": "\\u001b[31m"}]}'), b"HTTP/1.1 302 Found\r\nLocation: file:///etc/passwd\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\n\r\n{", http(b'"' + b"x" * (17 << 20)),
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nZZ\r\n",
    ],
)  # fmt: skip
def test_any_answer_of_a_phone_ends_in_one_line(tmp_path, body):
    with answering(body) as address, pytest.raises(SysidError) as caught:
        Phone(address, tmp_path / "log").connect()
    assert str(caught.value).isprintable()


def test_an_answer_that_drips_ends_in_time(tmp_path):
    begin = time.monotonic()
    with answering(http(b" " * 30), drip=True) as address, pytest.raises(SysidError):
        Phone(address, tmp_path / "log").connect()
    assert time.monotonic() - begin < 2 * PATIENCE


@pytest.mark.parametrize(
    "numbers", ["5", '["a"]', "[[1], [2]]", "null", "[" + "9" * 4000 + "]", '{"buffer": 1}']
)
def test_numbers_that_are_none_are_refused_in_one_line(tmp_path, numbers):
    names = ("gyr_time", "gyrX", "gyrY", "gyrZ")
    with answering(http(json.dumps({"buffers": [{"name": name} for name in names]}).encode())) as address:
        phone = Phone(address, tmp_path / "log")
        phone.connect()
    held = ", ".join(f'"{name}": {{"buffer": {numbers}}}' for name in names)
    with (
        answering(http(f'{{"buffer": {{{held}}}}}'.encode())) as phone.address,
        pytest.raises(SysidError, match="without the gyroscope's numbers"),
    ):
        phone.poll()
