"""A phone that replays an export of phyphox over its remote access: at its own pace, faster, or a step further with each question."""

import io
import json
import math
import threading
import time
import zipfile
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qsl, urlsplit

import numpy as np
from command_line import husky

BUFFERS = {
    "Gyroscope.csv": ("gyr_time", "gyrX", "gyrY", "gyrZ"),
    "Accelerometer.csv": ("acc_time", "accX", "accY", "accZ"),
}


def export_of_two_releases(folder):
    """Return the path of an export of phyphox."""
    path = folder / "tip.zip"
    husky("synth", "-b", "pink", "--releases", "2", "--rate", "200", "--dialect", "phyphox", "-o", path)
    return path


class RecordedPhone:
    """What the phone holds, and what it was asked."""

    def __init__(self, export, pace=1.0, without=(), silent_after=math.inf, step=None):
        self.pace, self.started, self.asked, self.silent_after = pace, None, [], silent_after
        self.step, self.stepped = step, 0.0
        self.buffers = {}
        with zipfile.ZipFile(export) as archive:
            for table, names in BUFFERS.items():
                columns = np.loadtxt(io.BytesIO(archive.read(table)), delimiter=",", skiprows=1).T
                self.buffers |= {
                    name: column for name, column in zip(names, columns, strict=True) if name not in without
                }

    @property
    def now(self):
        """Time of the experiment [s]."""
        if self.step is not None:
            return self.stepped
        return 0.0 if self.started is None else self.pace * (time.monotonic() - self.started)

    def answer(self, path):
        asked = urlsplit(path)
        self.asked.append(path)
        if asked.path == "/config":
            return {"title": "Inertia", "buffers": [{"name": name, "size": 0} for name in self.buffers]}
        if asked.path == "/control":
            self.started = time.monotonic()
            return {"result": True}
        buffers = {}
        self.stepped += self.step or 0.0
        now = self.now
        for name, wanted in parse_qsl(asked.query):
            threshold, _, reference = wanted.partition("|")
            clock = self.buffers[reference or name]
            rows = (clock > float(threshold)) & (clock <= now)
            buffers[name] = {"size": 0, "updateMode": "partial", "buffer": self.buffers[name][rows].tolist()}
        return {
            "buffer": buffers,
            "status": {"session": "a1b2c3", "measuring": True, "timedRun": False, "countDown": 0},
        }


@contextmanager
def recorded_phone(export, **how):
    """Serve an export on this machine; yields the phone and its address."""
    phone = RecordedPhone(export, **how)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            if phone.now > phone.silent_after:
                self.connection.close()
                return
            body = json.dumps(phone.answer(self.path)).encode()
            self.send_response(200)
            self.send_header("Content-Type", "application/json")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield phone, f"127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
