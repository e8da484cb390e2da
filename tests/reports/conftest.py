"""The browser of the pages' tests."""

import pytest


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    """A tab of headless Chromium."""
    pytest.importorskip("websockets", reason="the package websockets is not installed")
    from chromium import BINARY, browser

    if BINARY is None:
        pytest.skip("there is no Chromium here")
    with browser(tmp_path_factory.mktemp("chromium")) as opened:
        yield opened
