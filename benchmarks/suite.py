"""What suites of many logs share: a command line, and cases that are run once, a line of JSON each."""

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sysid.batch.runner import read_rows, run_all

Row = dict[str, Any]


def command_line(description: str | None) -> argparse.ArgumentParser:
    """Return a parser whose help is a module's docstring as it stands."""
    return argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def run_suite(
    run: Callable[..., Row], cases: Sequence[tuple[Any, ...]], key: Sequence[str], file: Path | None, *,
    workers: int, seconds: float = float("inf"), say: Callable[[Row], None] | None = None,
) -> list[Row]:  # fmt: skip
    """Run the cases whose row is not in a file yet; return the file's rows and the new ones.

    Args:
        run: Makes a row of a case's values.
        cases: Arguments of `run`.
        key: Where a row has the first of them.
        file: Rows as JSON lines: read, and appended to; None keeps nothing.
        workers: Processes.
        seconds: After which no more is run [s].
        say: Prints a row as it comes.
    """
    rows = [dict(row) for row in read_rows(file)] if file else []
    done = {tuple(row[name] for name in key) for row in rows}
    waiting = [case for case in cases if case[: len(key)] not in done]
    end = time.monotonic() + seconds
    for row in run_all(run, waiting, file, workers=workers):
        rows.append(dict(row))
        if say is not None:
            say(rows[-1])
        if time.monotonic() > end:
            break
    return rows
