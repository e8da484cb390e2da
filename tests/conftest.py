"""Fixtures shared by all tests."""

import ctypes.util
import os
from pathlib import Path
from typing import Any

import pytest

# MuJoCo chooses its way to OpenGL when it is imported; without a screen only EGL draws films.
if not os.environ.get("DISPLAY") and ctypes.util.find_library("EGL"):
    os.environ.setdefault("MUJOCO_GL", "egl")


@pytest.fixture(scope="session")
def real_logs() -> Path:
    """The folder of real measurements, which never travels with the project."""
    folder = Path(__file__).parents[2] / "shared" / "real_logs"
    if not folder.is_dir():
        pytest.skip("real measurements are not part of the project (no ../shared/real_logs here)")
    return folder


@pytest.fixture(scope="session")
def model() -> Any:
    """The G1 by itself, compiled; it comes with mjlab."""
    from sim.skate.robot import g1
    from sysid.errors import HuskyError

    try:
        return g1.g1_spec(visuals=False).compile()
    except HuskyError as error:
        pytest.skip(str(error))
