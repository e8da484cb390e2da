"""Effects of the user's own: one file anywhere, or an installed package's entry points `husky_sysid.effects`."""

import importlib.util
import os
import re
from collections.abc import Mapping
from importlib.metadata import entry_points
from pathlib import Path
from traceback import extract_tb

import numpy as np

from sysid.effects._algebra import NUMPY, casadi_algebra
from sysid.effects._base import Effect, JointState, TorqueEffect
from sysid.errors import SysidError

GROUP = "husky_sysid.effects"
FILES = "HUSKY_SYSID_EFFECT_FILES"
"""Environment variable with the files in use; processes of a search inherit it."""


def files() -> tuple[Path, ...]:
    """Return the files in use."""
    return tuple(Path(name) for name in os.environ.get(FILES, "").split(os.pathsep) if name)


def use(path: Path) -> Effect:
    """Add an effect's file, for this process and those that it starts.

    Raises:
        SysidError: The file does not exist, or does not make an effect; in one line.
    """
    found = read(path)
    kept = [str(known) for known in files() if known != path.resolve()]
    os.environ[FILES] = os.pathsep.join([*kept, str(path.resolve())])
    return found


def own_effects(taken: Mapping[str, Effect]) -> dict[str, tuple[Effect, str]]:
    """Return the effects of files in use and of installed packages by name, each with its origin.

    Raises:
        SysidError: One of them makes no effect, or its name is taken.
    """
    found: dict[str, tuple[Effect, str]] = {}
    sources = [(str(path), lambda path=path: read(path)) for path in files()]
    sources += [(f"{point.value} (installed)", point.load) for point in entry_points(group=GROUP)]
    for where, load in sources:
        try:
            part = checked(load(), where)
        except SysidError:
            raise
        except BaseException as error:
            raise SysidError(f"{where}: {_in_words(error)}") from error
        if part.name in taken or part.name in found:
            raise SysidError(f"{where}: there is an effect '{part.name}' already. Give yours another name.")
        found[part.name] = part, where
    return found


def read(path: Path) -> Effect:
    """Return the effect of a file.

    Raises:
        SysidError: The file does not exist, does not run, or makes no effect; in one line.
    """
    if not path.is_file():
        raise SysidError(f"{path}: there is no such file. A new one: husky-sysid effects new {path.stem}")
    spec = importlib.util.spec_from_file_location(f"husky_sysid_effect_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise SysidError(f"{path}: not a Python file; expected a name that ends in .py.")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        lines = [frame.lineno for frame in extract_tb(error.__traceback__) if frame.filename == str(path)]
        line = f"line {lines[-1]}, " if lines else ""
        raise SysidError(f"{path}: {line}{_in_words(error)}") from error
    return checked(getattr(module, "EFFECT", None), str(path))


def _in_words(error: BaseException) -> str:
    """Return an error in one line, even if its own message fails."""
    try:
        said = " ".join(str(error).split())[:200]
    except BaseException:  # noqa: BLE001  the class may be the file's own
        said = "(no message)"
    return f"{type(error).__name__}: {said}"


def checked(part: object, where: str) -> Effect:
    """Return an effect after a test run of its law.

    Raises:
        SysidError: It is not an effect, has an invalid name, or its torque does not run; in one line.
    """
    if not isinstance(part, Effect):
        raise SysidError(
            f"{where}: EFFECT is of type {type(part).__name__}; expected TorqueEffect(...), SensorEffect(...) or SupportEffect(...)."
        )
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", part.name):
        raise SysidError(
            f"{where}: name '{part.name}': expected small letters, digits and hyphens, such as 'my-effect'."
        )
    if len(part.example) != len(part.parameters):
        raise SysidError(
            f"{where}: {len(part.example)} numbers in `example`, but {len(part.parameters)} parameters; expected one for each."
        )
    if isinstance(part, TorqueEffect) and not part.states:
        _run(part, where)
    return part


def _run(part: TorqueEffect, where: str) -> None:
    """Run a torque on numbers and on symbols, as simulation and fit do."""
    import casadi

    values = part.named(part.example)
    at = np.linspace(-0.1, 0.1, 3)
    symbol = casadi.SX.sym("x")
    try:
        torque = np.asarray(part.torque(NUMPY, JointState(at, at, at, 10.0), values, ()), dtype=np.float64)
        part.torque(casadi_algebra(), JointState(symbol, symbol, symbol, 10.0), values, ())
    except BaseException as error:
        raise SysidError(
            f"{where}: its torque does not run ({_in_words(error)}). Use only + - * / ** and m.sin, m.cos, m.exp, m.abs, "
            "m.minimum, m.maximum, m.where, and the names of its parameters."
        ) from error
    if not np.all(np.isfinite(torque)):
        raise SysidError(
            f"{where}: its torque is {torque} at tilts of -0.1, 0 and 0.1 rad; expected finite numbers."
        )
