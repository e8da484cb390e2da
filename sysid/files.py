"""Writing files so that a failure at any moment leaves the old file whole."""

import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from pathlib import Path

from sysid.errors import HuskyError


@contextmanager
def atomic_path(path: Path) -> Generator[Path]:
    """Yield a temporary path beside `path`, and rename it to `path` only if the block succeeds.

    For writers that want a file name (matplotlib, Rerun, video). The suffix is kept, because some
    of them choose the format by it.

    Raises:
        HuskyError: The folder cannot be made or written to.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise HuskyError(
            f"{path}: cannot write there ({error.strerror}). Choose a folder you may write to, "
            "for example with --workspace."
        ) from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp makes files private; give them the permissions any other new file would have.
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    except OSError as error:
        raise HuskyError(f"{path}: cannot write there ({error.strerror or error}).") from error
    finally:
        temporary.unlink(missing_ok=True)


def refuse_overwriting(inputs: Iterable[Path], outputs: Mapping[str, Path | None]) -> None:
    """Refuse to write over a file that is read, by whatever name either is given.

    Args:
        inputs: Files that are read; of a folder, all files in it.
        outputs: Files that will be written, by the option that names them.

    Raises:
        HuskyError: An output is an input.
    """
    read = [path for path in inputs if path.exists()]
    for option, output in outputs.items():
        if output is None or not output.exists():
            continue  # what is not there yet cannot be lost
        for path in read:
            inside = path.is_dir() and output.resolve().is_relative_to(path.resolve())
            if inside or output.samefile(path):
                where = f"lies in {path}, which" if inside else "is the very file that"
                raise HuskyError(
                    f"{option} {output}: {where} is read here; it would be overwritten. Choose another name."
                )


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write `content` to `path`, replacing it in one step.

    Raises:
        HuskyError: The folder cannot be made or written to.
    """
    data = content.encode() if isinstance(content, str) else content
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_json(path: Path, content: object) -> None:
    """Write `content` as indented JSON in one step; NaN and infinity are refused.

    Raises:
        HuskyError: The folder cannot be made or written to.
    """
    write_atomically(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def sha256(path: Path, progress: Callable[[int], None] | None = None) -> str:
    """Return the SHA-256 of a file in hexadecimal, read in blocks of 1 MiB."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
            if progress is not None:
                progress(len(block))
    return digest.hexdigest()
