"""The same measurement given twice: it would count as new data, and narrow every interval."""

from collections.abc import Iterable
from pathlib import Path

from sysid.errors import HuskyError
from sysid.files import sha256


def refuse_twice(logs: Iterable[Path]) -> None:
    """Accept logs that are different measurements.

    A copy under another name is told by its content; a folder, or a file that is not there, by its path only.

    Raises:
        HuskyError: Two of the logs are the same.
    """
    files = list(logs)
    if len(files) < 2:
        return
    seen: dict[str, Path] = {}
    for log in files:
        key = sha256(log) if log.is_file() else str(log.resolve())
        first = seen.get(key)
        if first is not None:
            copy = f"{first} was given twice" if first == log else f"{first} and {log} hold the same bytes"
            raise HuskyError(
                f"{copy}: a measurement counts once, for a repeated one would narrow every interval without saying "
                "anything new. Leave one out, or record another."
            )
        seen[key] = log
