"""Fixtures shared by all tests."""

import ctypes.util
import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

# MuJoCo chooses its way to OpenGL when it is imported; without a screen only EGL draws films.
if not os.environ.get("DISPLAY") and ctypes.util.find_library("EGL"):
    os.environ.setdefault("MUJOCO_GL", "egl")

os.environ.pop("COLUMNS", None)  # how wide tables are must not depend on who runs the tests


@pytest.fixture(scope="session")
def real_logs() -> Path:
    """The folder of real measurements, which never travels with the project."""
    folder = Path(__file__).parents[2] / "shared" / "real_logs"
    if not folder.is_dir():
        pytest.skip("real measurements are not part of the project (no ../shared/real_logs here)")
    return folder


@pytest.fixture(scope="session")
def film_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder of rendered films for all processes of a test run; skips where nothing can be rendered."""
    try:
        import mujoco

        mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 8, 8).close()
    except Exception as error:  # noqa: BLE001  whatever a machine without OpenGL raises
        pytest.skip(
            f"films cannot be rendered here ({error}); install EGL (libegl1 libgl1-mesa-dri) or set MUJOCO_GL"
        )
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "films"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def film_of(film_folder: Path) -> Callable[[str], Any]:
    """The film of that name in `films.FILMS`, a `films.TestFilm`; rendered when it is first asked for."""
    from films import shared_film

    return functools.partial(shared_film, film_folder)


@pytest.fixture
def marker_film(film_of: Callable[[str], Any]) -> Any:
    """One release of a board with a marker, filmed by a good camera."""
    return film_of("marker")


@pytest.fixture(scope="session")
def model() -> Any:
    """The G1 by itself, compiled; it comes with mjlab."""
    from sim.skate.robot import g1
    from sysid.errors import SysidError

    try:
        return g1.g1_spec(visuals=False).compile()
    except SysidError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def pink() -> Any:
    """The shipped record of the compliant board."""
    from sysid.board import Board

    return Board.load("pink")


@pytest.fixture(scope="session", params=["pink", "black"])
def board(request: pytest.FixtureRequest) -> Any:
    """Each shipped record."""
    from sysid.board import Board

    return Board.load(request.param)
