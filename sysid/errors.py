"""Exceptions for expected failures."""

import difflib
from collections.abc import Generator, Iterable
from contextlib import contextmanager


class SysidError(Exception):
    """An expected failure: names the value, the likely cause and the next step.

    The command line prints it on one line and exits with `exit_code`; anything else is a bug and
    keeps its traceback.
    """

    exit_code = 1


class UsageError(SysidError):
    """A command lacks an argument, or its options conflict."""

    exit_code = 2


class QualityGateError(SysidError):
    """The computation succeeded, and its answer is no (see `check`)."""

    exit_code = 3


@contextmanager
def needs_extra(extra: str, what: str, otherwise: str = "") -> Generator[None]:
    """Name the extra of pyproject.toml that `what` needs, if an import fails, and the way without it.

    Raises:
        SysidError: A package cannot be imported.
    """
    try:
        yield
    except ImportError as error:
        raise SysidError(
            f"{what} needs an extra: {install_extra(extra)} (missing: {error.name}). {otherwise}".rstrip()
        ) from error


def install_extra(extra: str) -> str:
    """Return the command that installs an extra of this package, from its checkout or wheel."""
    from pathlib import Path

    root = Path(__file__).resolve().parents[1]
    if (root / "pyproject.toml").is_file():
        where = "." if root == Path.cwd() else str(root)
        return f"pip install -e '{where}[{extra}]'"
    return f"pip install 'WHEEL[{extra}]', with the wheel that husky-sysid was installed from"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ' Did you mean 'x'?' for the known name closest to `name`, or an empty string."""
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f" Did you mean '{close[0]}'?" if close else ""
