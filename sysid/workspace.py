"""Folder of a user's boards and outputs."""

import os
import shlex
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from sysid.board import Board, boards_folder, find_record, load_board, load_named, record_names, save_board
from sysid.errors import SysidError
from sysid.files import locked, write_atomically
from sysid.files import shipped_data as shipped_data
from sysid.shown import MOST_SHOWN


@dataclass(frozen=True, slots=True)
class Workspace:
    """A folder with the user's boards (`data/boards`) and outputs (`reports/<board>`)."""

    root: Path
    reading: tuple[str, ...] = ()
    """Options for reading the logs; printed commands repeat them."""

    @property
    def boards(self) -> Path:
        """The folder of the user's own board records."""
        return boards_folder(self.root)

    def command(self, name: str, *options: str, logs: Iterable[str | Path] | None = None) -> str:
        """Return a command that the user can copy and run in the current folder.

        Args:
            options: Its words besides logs and workspace.
            logs: Its logs; no logs or many are written as 'LOG...'. None: a command without logs.
        """
        named = [] if logs is None else [str(log) for log in logs]
        if logs is not None and not 0 < len(named) <= MOST_SHOWN:
            named = ["LOG..."]
        where = [] if self.root.resolve() == Path.cwd() else ["--workspace", str(self.root)]
        reading = [] if logs is None else self.reading
        return shlex.join(["husky-sysid", name, *named, *options, *reading, *where])

    def board_names(self) -> list[str]:
        """Return the names of all boards: the workspace's and the shipped ones."""
        return record_names(self.root)

    def board_path(self, name: str) -> Path:
        """Return the path of a record: the workspace's, else the shipped one.

        Raises:
            SysidError: There is no board of that name.
        """
        return find_record(name, self.root)

    def load_board(self, name: str) -> Board:
        """Read a board.

        Raises:
            SysidError: There is no such board, or its record is not valid.
        """
        board = load_named(name, self.root)
        for part in board.effects:
            if part.file:
                _require_known(board, part.name, part.file)
        return board

    def save_board(self, board: Board, *, since: Board | None = None) -> Path:
        """Write a board into the workspace and return its path.

        Another command may have changed the record meanwhile. Its history lines are kept. Only a refit, which determines the
        whole joint, may replace a changed joint.

        Args:
            since: The record from which `board` was made; None to overwrite any record.

        Raises:
            SysidError: The folder cannot be written to, or the joint has changed since.
        """
        path = self.boards / f"{board.name}.toml"
        with locked(path):
            if since is None:
                self._replace(board, path)
                return path
            now = self.load_board(board.name)
            is_refit = len(board.history) > len(since.history) and all(
                getattr(now, name) == getattr(since, name) for name in ("geometry", "mass", "inertia")
            )
            if now.digest != since.digest and not is_refit:
                raise SysidError(
                    f"{path}: another command changed the joint during this run. This result was discarded; run the command again."
                )
            new = board.history[len(since.history) :]
            self._replace(replace(board, history=(*now.history, *new)), path)
        return path

    def _replace(self, board: Board, path: Path) -> None:
        """Write a record, and keep the old one for `undo`."""
        try:
            old = self.board_path(board.name).read_bytes()
        except SysidError:  # there is none
            save_board(board, path)
            return
        kept = self.earlier(board.name)
        number = int(kept[-1].stem) + 1 if kept else 1
        write_atomically(self._earlier(board.name) / f"{number:04d}.toml", old)
        save_board(board, path)

    def _earlier(self, name: str) -> Path:
        return self.boards / ".earlier" / name

    def earlier(self, name: str) -> list[Path]:
        """Return the earlier records of a board, oldest first."""
        return sorted(self._earlier(name).glob("[0-9]*.toml"))  # without temporary files of killed commands

    def first(self, name: str) -> Board | None:
        """Return the first record of a board, before any change in this workspace; None without a change.

        Raises:
            SysidError: That record is not valid.
        """
        kept = self.earlier(name)
        return load_board(kept[0]) if kept else None

    def undo(self, name: str) -> Path:
        """Restore the record of a board before its last change, and return its path.

        Raises:
            SysidError: It was never changed here.
        """
        path = self.boards / f"{name}.toml"
        with locked(path):
            kept = self.earlier(name)
            if not kept:
                raise SysidError(
                    f"board '{name}' was never changed in this workspace, so there is nothing to go back to. Is it in another "
                    "(--workspace)?"
                )
            write_atomically(path, kept[-1].read_bytes(), is_record=True)
            kept[-1].unlink()
        return path

    def named(self, path: Path) -> str:
        """Return the name of a file in a record: its path relative to the workspace.

        An absolute path stays absolute. Links are resolved first, so `..` in a linked workspace is right.
        """
        if path.is_absolute():
            return str(path)
        return Path(os.path.relpath(path.parent.resolve() / path.name, self.root.resolve())).as_posix()

    def recorded(self, name: str) -> Path:
        """Return the file of a name in a record: relative to the current folder, or absolute if the name or the workspace is."""
        path = self.root / name
        if Path(name).is_absolute():
            return path
        found = path.parent.resolve() / path.name
        return found if path.is_absolute() else Path(os.path.relpath(found))

    def outputs(self, board: str) -> Path:
        """Return the folder for a board's outputs; it is made with the first output."""
        return self.root / "reports" / board


def _require_known(board: Board, name: str, file: str) -> None:
    """Check that a user's effect in a record is loaded.

    Raises:
        SysidError: The effect is unknown; the message names the file.
    """
    from sysid.effects import catalogue

    if name not in catalogue():
        raise SysidError(
            f"board '{board.name}' has the effect '{name}', which {file} makes. Add --effect-file {file}"
        )
