"""Atomic writing of files: after a failure the old file is intact."""

import errno
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.errors import SysidError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_TEXT = 4_000_000
"""Largest record or manifest [bytes]."""
RECORDS = "data/boards/*.toml"
"""Records of boards in a workspace."""


def shipped_data() -> Path:
    """Return the data folder of the tool: in an installed wheel, or in the repository."""
    package = Path(__file__).resolve().parent
    installed = package / "_data"
    return installed if installed.is_dir() else package.parent / "data"


def regular(path: Path) -> Path:
    """Return a path to a file, or to nothing: a pipe waits for its writer, and a device may have no end.

    Raises:
        OSError: It exists, and is not a file.
    """
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is no file but a folder, a pipe or a device", str(path))
    return path


def read_small(path: Path, encoding: str = "utf-8") -> str:
    """Return the text of a file that people write by hand, such as a record or a manifest.

    Raises:
        OSError: It cannot be read, or is larger than 4 MB, ten times a record with a thousand refits.
    """
    if regular(path).stat().st_size > MAX_TEXT:
        raise OSError(errno.EFBIG, "more than 4 MB: too long for a text typed by hand", str(path))
    return path.read_text(encoding=encoding)


@contextmanager
def atomic_path(path: Path, *, is_record: bool = False) -> Generator[Path]:
    """Yield a temporary path beside `path`, and rename it to `path` only if the block succeeds.

    For writers that need a file name (matplotlib, Rerun, video). It keeps the suffix, which gives some of them the
    format. A link stays a link: its target is replaced. Into a device or a pipe the content is copied.

    Args:
        is_record: Whether it is a board's record; only a record replaces a record.

    Raises:
        SysidError: The folder cannot be made or written to, or the path is that of a record.
    """
    try:
        target = path.resolve()
        if target.match(RECORDS) and target.exists() and not is_record:
            raise SysidError(f"{path}: holds a board's record; it would be lost. Choose another name.")
        is_special = target.exists() and not target.is_file()
        if target.is_dir():
            raise IsADirectoryError(None, "it is a folder")
        target.parent.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.gettempdir()) if is_special else target.parent
    except (OSError, RuntimeError) as error:  # RuntimeError: links in a circle
        raise _unwritable(path, error) from error
    temporary = folder / f".{target.stem[:60]}-{os.urandom(6).hex()}{path.suffix}"
    try:
        try:
            temporary.touch(mode=0o600 if is_special else 0o666, exist_ok=False)
        except OSError as error:
            raise _unwritable(path, error) from error
        yield temporary
        if is_special:
            with temporary.open("rb") as source, target.open("wb") as sink:
                shutil.copyfileobj(source, sink)
        else:
            temporary.replace(target)
    except OSError as error:
        raise SysidError(f"{path}: cannot write there ({error.strerror or error}).") from error
    finally:
        temporary.unlink(missing_ok=True)


def require_writable(path: Path) -> None:
    """Check that a file can be written, before long work on its content; create nothing.

    Raises:
        SysidError: It is a folder, or its folder cannot be made or written to.
    """
    try:
        target = path.resolve()
        if target.is_dir():
            raise IsADirectoryError(None, "it is a folder")
        if target.exists() and not target.is_file():
            return  # a device or a pipe
        there = next(parent for parent in target.parents if parent.exists())
        if not there.is_dir():
            raise NotADirectoryError(None, f"{there} is a file, no folder")
        if not os.access(there, os.W_OK | os.X_OK):
            raise PermissionError(None, f"{there} is not yours to write into")
    except (OSError, RuntimeError) as error:
        raise _unwritable(path, error) from error


def _unwritable(path: Path, error: OSError | RuntimeError) -> SysidError:
    return SysidError(
        f"{path}: cannot write there ({getattr(error, 'strerror', None) or error}). Choose a folder you may write "
        "to, for example with --workspace."
    )


@contextmanager
def locked(path: Path, *, patience: float = 60.0) -> Generator[None]:
    """Lock a file against other processes.

    The lock is in the folder of temporary files and ends with the process. Its file is deleted before the release, so
    that the next process makes a new one.

    Args:
        path: The file; need not exist.
        patience: Longest wait for another process [s].

    Raises:
        SysidError: Another process holds it for longer.
    """
    from filelock import FileLock, Timeout

    key = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:16]
    lock = Path(tempfile.gettempdir()) / f"husky-sysid-{key}.lock"
    try:
        with FileLock(lock, timeout=patience):
            try:
                yield
            finally:
                with suppress(PermissionError):  # Windows cannot delete an open file; FileLock does so later
                    lock.unlink(missing_ok=True)
    except Timeout as error:
        raise SysidError(
            f"{path}: another command has held it for {patience:g} s. Wait for it, or end it, and try again."
        ) from error


def refuse_other_kind(output: Path, *endings: str) -> None:
    """Refuse to overwrite a file of another kind, such as a log named by mistake.

    Raises:
        SysidError: A file of this name exists and has another ending.
    """
    if output.is_file() and output.suffix.lower() not in endings:
        raise SysidError(
            f"--output {output}: exists, and is not a {' or '.join(endings)} file like the output; it would be lost. Choose another "
            "name."
        )


def refuse_overwriting(inputs: Iterable[Path], outputs: Mapping[str, Path | None]) -> None:
    """Refuse to overwrite an input, also under another name.

    Args:
        inputs: Input files; a folder stands for all files in it.
        outputs: Output files by their options.

    Raises:
        SysidError: An output is an input.
    """
    read = [path for path in inputs if path.exists()]
    for option, output in outputs.items():
        if output is None or not output.exists():
            continue  # nothing to lose
        for path in read:
            inside = path.is_dir() and output.resolve().is_relative_to(path.resolve())
            if inside or output.samefile(path):
                where = f"is in the input folder {path}" if inside else "is an input"
                raise SysidError(f"{option} {output}: {where}; it would be overwritten. Choose another name.")


def write_figure(path: Path, figure: "Figure", *, dpi: int = 140) -> Path:
    """Write a figure in one step and return its path; see `atomic_path`."""
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=dpi)
    return path


def write_atomically(path: Path, content: str | bytes, *, is_record: bool = False) -> None:
    """Write `content` to `path`, replacing it in one step; see `atomic_path`."""
    data = content.encode() if isinstance(content, str) else content
    with atomic_path(path, is_record=is_record) as temporary:
        temporary.write_bytes(data)


def write_json(path: Path, content: object) -> None:
    """Write `content` as indented JSON in one step; NaN and infinity are refused."""
    write_atomically(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
