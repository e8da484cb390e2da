"""The one exception that a user may see."""

import difflib
from collections.abc import Generator, Iterable
from contextlib import contextmanager


class SysidError(Exception):
    """An expected failure: names the value, the likely cause and the next step.

    The command line prints it on one line and exits with `exit_code`; anything else is a bug and
    keeps its traceback.
    """

    exit_code = 1


HuskyError = SysidError
"""The name of old."""


class UsageError(SysidError):
    """A command was given too little, or options that do not go together."""

    exit_code = 2


class QualityGateError(SysidError):
    """The computation went well and its answer is no (see `check`)."""

    exit_code = 3


@contextmanager
def needs_extra(extra: str, what: str, otherwise: str = "") -> Generator[None]:
    """Say of which extra of pyproject.toml a package is that cannot be imported for `what`, and what to do without it.

    Raises:
        SysidError: It cannot be imported.
    """
    try:
        yield
    except ImportError as error:
        raise SysidError(
            f"{what} needs an extra: {install_extra(extra)} (missing: {error.name}). {otherwise}".rstrip()
        ) from error


def install_extra(extra: str) -> str:
    """Return the command that installs an extra of this package where it was installed from: a checkout, or a wheel."""
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
