"""The joint of a command: a board of the workspace, or a joint of a MuJoCo model."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Group, Parameter

from sysid.board import Board
from sysid.cli.console import BoardName, Common, Printer, Texts
from sysid.cli.parameter_options import parse_fixed
from sysid.errors import SysidError, UsageError

if TYPE_CHECKING:
    from sim.model.setup import Setup
    from sysid.recording import Recording

SUBJECT = Group("Joint", sort_key=0)


@Parameter(name="*", group=SUBJECT)
@dataclass(frozen=True, kw_only=True)
class Subject:
    """The joint of a command: that of a board, or one of a MuJoCo model in the setup of the measurement."""

    board: BoardName | None = None
    """Name of the board."""
    model: Path | None = None
    """MuJoCo model, instead of a board."""
    joint: str | None = None
    """Released hinge or slide of the model; all others were held."""
    keyframe: str | None = None
    """Keyframe of the model with the pose of the measurement."""
    pose: Texts = ()
    """Position of another joint there, as NAME=VALUE in rad or m; repeat it for several."""
    free: Texts = ()
    """Another joint that moved freely, not held; repeat it for several."""
    payload: Texts = ()
    """Known added mass, as MASS@X,Y,Z [kg, m] in the frame of the joint's body, or MASS@SITE."""
    mass_error: float = 0.0
    """Half-width of the 95 % interval of the model's masses, as a share, e.g. 0.02; every torque shares it."""

    @property
    def setup(self) -> "Setup | None":
        """Setup of the measurement of a model's joint; None for a board."""
        if self.model is None:
            given = {"--joint": self.joint, "--keyframe": self.keyframe, "--pose": self.pose, "--free": self.free,
                     "--payload": self.payload}  # fmt: skip
            if unused := [name for name, value in given.items() if value]:
                raise UsageError(f"{', '.join(unused)}: only with --model, which says whose joint it is.")
            return None
        from sim.model.setup import Payload, Setup

        if self.board is not None:
            raise UsageError("--board and --model: give the one whose joint was measured.")
        if self.joint is None:
            raise UsageError(f"--model {self.model}: which joint of it was let go? Name it with --joint.")
        return Setup(
            file=self.model, joint=self.joint, keyframe=self.keyframe or "", pose=parse_fixed(self.pose, "--pose"),
            free=self.free, payload=tuple(map(Payload.parse, self.payload)),
        )  # fmt: skip

    def load(self, common: Common, printer: Printer) -> Board:
        """Return the record of the board, or that of the model's joint."""
        record = self.find(common, printer)
        if record is None:
            raise UsageError(
                "whose joint is it? Name a board (--board), or a joint of a model (--model, --joint)."
            )
        return record

    def find(self, common: Common, printer: Printer) -> Board | None:
        """Return the same, or None without board and model."""
        setup = self.setup
        if setup is None:
            return None if self.board is None else common.space.load_board(self.board)
        from sim.model.faults import warnings_of
        from sim.model.subject import board_of

        if not 0 <= self.mass_error < 1:
            raise SysidError(f"--mass-error {self.mass_error:g}: expected a share such as 0.02.")
        record, notes = board_of(setup, mass_error=self.mass_error)
        printer.note("\n".join((f"joint '{setup.joint}' of {setup.file}", *(f"  {note}" for note in notes))))
        if self.mass_error == 0:
            printer.note("  the model's masses are taken as exact (--mass-error says otherwise)")
        printer.warnings(warnings_of(setup))
        return record

    def logs(self, given: Sequence[Path]) -> "tuple[list[Path], list[Setup]]":
        """Return the logs, with the logs of lists (TOML files), and the setup of each; no setups for a board."""
        setup = self.setup
        if setup is None or not any(path.suffix == ".toml" for path in given):
            if lists := [path for path in given if path.suffix == ".toml"]:
                raise SysidError(
                    f"{lists[0]}: a list of logs says poses and loads of a model (--model, --joint)."
                )
            return list(given), []
        from sim.model.runs import read_runs

        runs = [
            run
            for path in given
            for run in (read_runs(path, setup) if path.suffix == ".toml" else [(path, setup)])
        ]
        return [log for log, _ in runs], [setup for _, setup in runs]

    def posed(
        self, record: Board, recordings: "list[Recording]", setups: "list[Setup]"
    ) -> "tuple[Board, list[Recording]]":
        """Return record and recordings with the numbers of each pose and payload; unchanged for a board."""
        if not setups:
            return record, recordings
        from sim.model.subject import pose_releases

        return pose_releases(record, recordings, setups)

    def save(self, record: Board, since: Board, common: Common) -> Path:
        """Write a record into the workspace; a model's record replaces the old one, which `undo` restores."""
        if self.model and record.name not in common.space.board_names():
            common.space.save_board(since)  # the unfitted model: the report begins there
        return common.space.save_board(record, since=None if self.model else since)
