"""Pictures of recordings and pages, by a viewer and a browser without a window."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.errors import SysidError

if TYPE_CHECKING:
    from collections.abc import Generator

    from rerun.experimental import ViewerClient

PATIENCE = 60.0
"""Time for a viewer to start and its picture to settle [s]: a choice, ten times that on a busy machine."""
PAUSE = 1.0
"""Between two pictures that are compared [s]."""
MENU_BAR = 37
"""Height of the viewer's menu bar [px]."""


@contextmanager
def headless_viewer() -> "Generator[ViewerClient]":
    """Run a Rerun viewer without a window, on this machine only.

    Raises:
        SysidError: It does not start; most often there is no Vulkan driver.
    """
    from rerun.experimental import ViewerClient

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = int(free.getsockname()[1])
    program = shutil.which("rerun", path=str(Path(sys.executable).parent)) or "rerun"
    process = subprocess.Popen(
        [program, "--headless", "--bind", "127.0.0.1", "--port", str(port), "--window-size", "1500x850"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )  # fmt: skip
    try:
        yield _connected(ViewerClient, process, port)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)  # `rerun` is a script: the viewer is its child
        process.wait(20)


def _connected(client: "type[ViewerClient]", process: "subprocess.Popen[bytes]", port: int) -> "ViewerClient":
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline and process.poll() is None:
        try:
            viewer = client.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            viewer.get_state()
        except (RuntimeError, ConnectionError, TimeoutError, OSError):
            time.sleep(0.3)
        else:
            return viewer
    raise SysidError("the Rerun viewer does not start without a window; it needs a Vulkan driver.")


def recording_picture(viewer: "ViewerClient", recording: Path, time_s: float) -> bytes:
    """Return a viewer's picture of a recording, as PNG, without the menu bar (its badges depend on the machine).

    Args:
        viewer: From `headless_viewer`.
        time_s: Time of the cursor [s].

    Raises:
        SysidError: The viewer does not answer, or its picture does not settle.
    """
    import cv2
    import numpy as np

    def picture() -> np.ndarray:
        shot = cv2.imdecode(np.frombuffer(viewer.take_screenshot(), np.uint8), cv2.IMREAD_COLOR)
        if shot is None:
            raise RuntimeError("the viewer sent no picture")
        return shot[MENU_BAR:]

    deadline = time.monotonic() + PATIENCE
    try:
        viewer.open(str(recording.resolve()))
        before, last = picture(), None
        while time.monotonic() < deadline:  # opening answers before everything is laid out
            time.sleep(PAUSE)
            viewer.set_time("t", duration=time_s, play_state="paused")
            shot = picture()
            if last is not None and np.array_equal(shot, last) and not np.array_equal(shot, before):
                return cv2.imencode(".png", shot)[1].tobytes()
            last = shot
    except (RuntimeError, ConnectionError, TimeoutError, OSError) as error:
        raise SysidError(f"the Rerun viewer does not answer: {error}") from error
    raise SysidError(f"the Rerun viewer was still drawing {recording} after {PATIENCE:g} s.")


def page_picture(page: Path, picture: Path) -> None:
    """Draw the top of a page as a browser shows it, with the network off.

    Raises:
        SysidError: There is no Chromium, or it fails.
    """
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        raise SysidError("a picture of a page needs Chromium.")
    with tempfile.TemporaryDirectory() as profile:
        flags = [
            "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
            "--disable-component-update", "--disable-sync", "--no-first-run", "--hide-scrollbars",
            "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={profile}",
            "--window-size=1000,1400", f"--screenshot={picture.resolve()}",
        ]  # fmt: skip
        done = subprocess.run(
            [browser, *flags, page.resolve().as_uri()], capture_output=True, check=False, timeout=120
        )
    if done.returncode != 0 or not picture.is_file():
        raise SysidError(f"Chromium drew no picture of {page}.")
