"""Rules of `check`, each a file that is found by being here.

A rule has one to three generators of sentences on a case: `failures`, `causes` of a failure, `warnings` of a pass.
"""

import importlib
import pkgutil
from typing import Literal

from sim.check.case import Case


def said(kind: Literal["failures", "causes", "warnings"], case: Case) -> tuple[str, ...]:
    """Return the sentences of every rule."""
    rules = [importlib.import_module(f"{__name__}.{name}") for _, name, _ in pkgutil.iter_modules(__path__)]
    return tuple(sentence for rule in rules if hasattr(rule, kind) for sentence in getattr(rule, kind)(case))
