"""A command as the shell runs it, but in this process: what it prints, and its exit code."""

import contextlib
import io
import os
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

from sysid.cli import build_app, main


@dataclass(frozen=True)
class Done:
    """What `subprocess.run` would say."""

    returncode: int
    stdout: str
    stderr: str


def husky(*arguments: object, cwd: Path | None = None) -> Done:
    """Run `husky-sysid` with these arguments in a folder."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        contextlib.chdir(cwd or Path()),
        mock.patch.dict(os.environ, {"COLUMNS": "160", "NO_COLOR": "1"}),
        mock.patch.object(sys, "argv", ["husky-sysid", *map(str, arguments)]),
        warnings.catch_warnings(),
    ):
        # cyclopts thinks that a test would pass the arguments; here they come as from the shell.
        warnings.filterwarnings("ignore", "Cyclopts application invoked without tokens")
        try:
            main()
        except SystemExit as stop:
            code = stop.code or 0
    return Done(code, out.getvalue(), err.getvalue())


def called(*arguments: object) -> int:
    """Run a command in this process and return its exit code; what it refuses is raised."""
    words = list(map(str, arguments))
    return build_app()(words, result_action="return_value", exit_on_error=False, print_error=False) or 0
