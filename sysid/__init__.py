"""Find out why a MuJoCo joint does not behave like the real one, and correct it.

Twelve names are the public API. All others can be imported from their modules, and may move. A name is loaded at its
first use, so that `import sysid` is fast.
"""

from importlib import import_module

TYPE_CHECKING = False  # as in `typing`, whose import would take longer than all the rest
if TYPE_CHECKING:
    from typing import Any

    from sysid.comparison.compare import compare
    from sysid.diagnosis.diagnose import diagnose
    from sysid.effects import Effect
    from sysid.errors import SysidError
    from sysid.fit_mjcf import fit
    from sysid.free_decay import fit_decay
    from sysid.joint import simulate
    from sysid.loop import Board, Joint, report
    from sysid.quantity import Quantity
    from sysid.recording import Recording

__all__ = [
    "Board",
    "Effect",
    "Joint",
    "Quantity",
    "Recording",
    "SysidError",
    "compare",
    "diagnose",
    "fit",
    "fit_decay",
    "report",
    "simulate",
]

_HOMES = {
    "Board": "sysid.loop",
    "Effect": "sysid.effects",
    "Joint": "sysid.loop",
    "Quantity": "sysid.quantity",
    "Recording": "sysid.recording",
    "SysidError": "sysid.errors",
    "compare": "sysid.comparison.compare",
    "diagnose": "sysid.diagnosis.diagnose",
    "fit": "sysid.fit_mjcf",
    "fit_decay": "sysid.free_decay",
    "report": "sysid.loop",
    "simulate": "sysid.joint",
}
"""The module that each name is loaded from."""


def __getattr__(name: str) -> "Any":
    """Load a public name at its first use."""
    if name not in _HOMES:
        raise AttributeError(f"module 'sysid' has no attribute '{name}'; it offers {', '.join(__all__)}")
    value = globals()[name] = getattr(import_module(_HOMES[name]), name)
    return value


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted({*globals(), *__all__})
