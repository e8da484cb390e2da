"""Trackers, one a module, found by being there.

A new tracker is a new module in this folder that ends in `TRACKER = Tracker(...)`; its file name is the name that
`--method` takes. Names are listed without importing anything: OpenCV is slow to start.
"""

import importlib
import pkgutil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sysid.video.trackers._base import Tracker

    Method = str
else:
    from typing import Literal


def names() -> tuple[str, ...]:
    """Return the names of all trackers, sorted."""
    return tuple(sorted(name for _, name, _ in pkgutil.iter_modules(__path__) if name[0] != "_"))


def load(name: str) -> "Tracker":
    """Return the tracker of that name."""
    return importlib.import_module(f"{__name__}.{name}").TRACKER


def ranked() -> "dict[str, Tracker]":
    """Return all trackers by name, the one that is tried first first."""
    found = {name: load(name) for name in names()}
    return dict(sorted(found.items(), key=lambda item: item[1].rank))


if not TYPE_CHECKING:
    Method = Literal[("auto", *names())]
"""Values of `--method`: the names, and auto."""
