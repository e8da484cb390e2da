"""CONTRIBUTING.md has a row for every package, and tests lie where what they test lies."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("sysid", "sim", "policy_runtime", "reports")
OF_THEMSELVES = {"support", "data"}
"""Folders of tests that belong to no package."""


def packages():
    files = (path for package in PACKAGES for path in (ROOT / package).rglob("__init__.py"))
    return {path.parent.relative_to(ROOT).as_posix() for path in files}


def test_every_package_has_its_row():
    rows = re.findall(r"^\| `([\w/]+)/` \|", (ROOT / "CONTRIBUTING.md").read_text(), re.M)
    assert len(rows) == len(set(rows))
    assert set(rows) == packages() | {"data"}


def test_tests_mirror_the_packages():
    folders = {
        path.parent.relative_to(ROOT / "tests").as_posix() for path in (ROOT / "tests").rglob("test_*.py")
    }
    places = {package.removeprefix("sysid/") for package in packages()} | OF_THEMSELVES | {"."}
    assert folders <= places
