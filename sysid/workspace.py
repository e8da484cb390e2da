"""Where boards are found and outputs land."""

import os
import shlex
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from sysid.board import Board, boards_folder, find_record, load_board, load_named, record_names, save_board
from sysid.errors import SysidError
from sysid.files import locked, write_atomically
from sysid.files import shipped_data as shipped_data

MOST_NAMED = 4
"""Logs written out in a command."""


@dataclass(frozen=True, slots=True)
class Workspace:
    """A folder with the user's boards (`data/boards`) and outputs (`reports/<board>`)."""

    root: Path
    reading: tuple[str, ...] = ()
    """Options that the logs needed to be read; commands that are printed repeat them."""

    @property
    def boards(self) -> Path:
        """The folder of the user's own board records."""
        return boards_folder(self.root)

    def command(self, name: str, *options: str, logs: Iterable[str | Path] | None = None) -> str:
        """Return a command that runs as it is printed, where the one that prints it was run.

        Args:
            options: Its words beside logs and workspace.
            logs: Its logs; 'LOG...' stands for none and for many, and nothing for None.
        """
        named = [] if logs is None else [str(log) for log in logs]
        if logs is not None and not 0 < len(named) <= MOST_NAMED:
            named = ["LOG..."]
        where = [] if self.root.resolve() == Path.cwd() else ["--workspace", str(self.root)]
        reading = [] if logs is None else self.reading
        return shlex.join(["husky-sysid", name, *named, *options, *reading, *where])

    def board_names(self) -> list[str]:
        """Return the names of all boards: the workspace's and the shipped ones."""
        return record_names(self.root)

    def board_path(self, name: str) -> Path:
        """Return the record that `name` means: the workspace's, else the shipped one.

        Raises:
            SysidError: There is no board of that name.
        """
        return find_record(name, self.root)

    def load_board(self, name: str) -> Board:
        """Read the board that `name` means.

        Raises:
            SysidError: There is no such board, or its record is not valid.
        """
        board = load_named(name, self.root)
        for part in board.effects:
            if part.file:
                _require_known(board, part.name, part.file)
        return board

    def save_board(self, board: Board, *, since: Board | None = None) -> Path:
        """Write a board into the workspace and return its path; in a clone that is where the shipped ones are, too.

        Commands run for minutes, and others may write the record meanwhile. What they added to its history stays; only
        a refit, which finds the whole joint anew, may replace a joint that has changed since.

        Args:
            since: The record as it was read, which `board` was made from; None to write whatever is there.

        Raises:
            SysidError: The folder cannot be written to, or what `board` says was found for a joint that has changed
                since.
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
                    f"{path}: the joint was changed by another command while this one ran, so what this one found is "
                    "not true of it. The record stays as the other wrote it; run this again."
                )
            new = board.history[len(since.history) :]
            self._replace(replace(board, history=(*now.history, *new)), path)
        return path

    def _replace(self, board: Board, path: Path) -> None:
        """Write a record, and keep the one that it replaces for `undo`."""
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
        """Return the records that a board had before, oldest first."""
        return sorted(self._earlier(name).glob("[0-9]*.toml"))  # not what a killed command left half-written

    def first(self, name: str) -> Board | None:
        """Return a board as it was before it was first written in this workspace; None if it never was.

        Raises:
            SysidError: That record is not valid.
        """
        kept = self.earlier(name)
        return load_board(kept[0]) if kept else None

    def undo(self, name: str) -> Path:
        """Put a board's record back to what it was before it was last written, and return its path.

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
        """Return how a record of this workspace names a file: from the workspace on, so that it is found from anywhere.

        An absolute path stays as it is. Folders count where they really are: `..` out of a linked workspace leads there.
        """
        if path.is_absolute():
            return str(path)
        return Path(os.path.relpath(path.parent.resolve() / path.name, self.root.resolve())).as_posix()

    def recorded(self, name: str) -> Path:
        """Return the file that a record of this workspace names so, as seen from the current folder, or from / where either is absolute."""
        path = self.root / name
        if Path(name).is_absolute():
            return path
        found = path.parent.resolve() / path.name
        return found if path.is_absolute() else Path(os.path.relpath(found))

    def outputs(self, board: str) -> Path:
        """Return the folder for a board's outputs; it is made when something is written to it."""
        return self.root / "reports" / board


def _require_known(board: Board, name: str, file: str) -> None:
    """Ask for the file of a user's effect that a record's law needs.

    Raises:
        SysidError: The effect is not known; the message names the file.
    """
    from sysid.effects import catalogue

    if name not in catalogue():
        raise SysidError(
            f"board '{board.name}' has the effect '{name}', which {file} makes. Add --effect-file {file}"
        )
