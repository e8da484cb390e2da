"""Fixtures shared by all tests."""

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def real_logs() -> Path:
    """The folder of real measurements, which never travels with the project."""
    folder = Path(__file__).parents[2] / "shared" / "real_logs"
    if not folder.is_dir():
        pytest.skip("real measurements are not part of the project (no ../shared/real_logs here)")
    return folder
