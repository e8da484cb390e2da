"""Formats and sensors are found by being there: one module of a folder each."""

import importlib
import pkgutil
from types import ModuleType
from typing import Any


def found_in(package: ModuleType, kind: type[Any]) -> list[Any]:
    """Return the objects of a kind in the modules of a package, in their `order`."""
    modules = [
        importlib.import_module(f"{package.__name__}.{one.name}")
        for one in pkgutil.iter_modules(package.__path__)
    ]
    found = {
        value.name: value for module in modules for value in vars(module).values() if isinstance(value, kind)
    }
    return sorted(found.values(), key=lambda value: value.order)
