"""The loop in Python: a joint from a record or a model, its check, its MJCF and its report.

`Joint` is the record of one joint, and `Board` a joint with a board's geometry. Both are the records of `sysid.board` with
the steps after the fit as methods; `fit`, `compare` and `diagnose` accept them.
"""

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import fields
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from sysid import board as records
from sysid.errors import SysidError
from sysid.files import write_atomically
from sysid.quantity import Quantity, parse_quantity
from sysid.recording import Data, Recording, unpack
from sysid.workspace import Workspace

if TYPE_CHECKING:
    from sim.check.verdict import Verdict
    from sysid.diagnosis.diagnose import Diagnosis


class Joint(records.Board):
    """The record of one joint: inertia, stiffness, damping and effects, each with its source."""

    __slots__ = ()

    @classmethod
    def of(cls, record: records.Board) -> Self:
        """Return a record as a joint."""
        return cls(**{one.name: getattr(record, one.name) for one in fields(record)})

    @classmethod
    def load(cls, name: str | Path, workspace: str | Path = ".") -> Self:
        """Read a record.

        Args:
            name: A record of the workspace, or one that ships with the tool; or a file, NAME.toml.
            workspace: Folder with the user's records, in data/boards.

        Raises:
            SysidError: There is no such record, or it is not valid.
        """
        return cls.of(records.Board.load(name, workspace))

    @classmethod
    def from_mjcf(
        cls,
        path: str | Path,
        joint: str,
        *,
        pose: Mapping[str, float] | None = None,
        keyframe: str = "",
        free: Sequence[str] = (),
        payload: Sequence[str] = (),
        mass_error: float = 0.0,
    ) -> Self:
        """Take a hinge or slide of a MuJoCo model, in the setup of the measurement.

        Args:
            path: The MJCF, with its includes.
            joint: The released joint; all others were held.
            pose: Positions of other joints in the measurement [rad or m].
            keyframe: Keyframe of the model with the pose of the measurement.
            free: Other joints that moved freely.
            payload: Known added masses: 'MASS@X,Y,Z' [kg, m] in the frame of the joint's body, or 'MASS@SITE'.
            mass_error: Half-width of the 95 % interval of the model's masses, as a share.

        Raises:
            SysidError: The file cannot be read, lacks the joint, or a loop holds it.
        """
        from sim.model.setup import Payload, Setup
        from sim.model.subject import board_of

        if not 0 <= mass_error < 1:
            raise SysidError(f"mass_error {mass_error:g}: expected a share such as 0.02.")
        setup = Setup(
            file=Path(path), joint=joint, keyframe=keyframe, pose=dict(pose or {}), free=tuple(free),
            payload=tuple(map(Payload.parse, payload)),
        )  # fmt: skip
        return cls.of(board_of(setup, mass_error=mass_error)[0])

    @classmethod
    def new(cls, name: str, inertia: Quantity | float | str, *, description: str = "a joint") -> Self:
        """Make the smallest record: an inertia, and no spring and damper yet.

        Args:
            name: Of the record.
            inertia: Inertia about the axis [kg*m^2]: a quantity, an exact number, or a text such as '0.0087±0.0001'.
            description: In words.

        Raises:
            SysidError: The inertia is not a positive number.
        """
        if isinstance(inertia, Quantity):
            known = inertia
        else:
            known = parse_quantity(str(inertia), "kg*m^2", "inertia")
        return cls(
            name=name, description=description, source="sysid.Joint.new",
            inertia=known if known.method else known.with_method("as given"),
            tilt={
                "stiffness": Quantity(0.0, 0.0, "N*m/rad"), "damping": Quantity(0.0, 0.0, "N*m*s/rad"),
                "rest_angle": Quantity(0.0, 0.0, "rad"), "range": Quantity(math.pi, 0.0, "rad"),  # without known stops
            },
        )  # fmt: skip

    def check(
        self,
        data: Data,
        *,
        tolerance: float = 0.02,
        scene_file: str | Path | None = None,
        scene_joint: str | None = None,
        timestep: float | None = None,
    ) -> "Verdict":
        """Release the joint in its MuJoCo scene as in the logs, and compare.

        The record does not change; `joint.checked(verdict.entry())` is the record with the verdict.

        Args:
            data: Measured decays.
            tolerance: Largest accepted NRMSE: RMS error without sensor noise over RMS motion about rest [1].
            scene_file: An MJCF scene to check instead of the built one.
            scene_joint: Its tilt joint.
            timestep: Step [s]; 0.005, or that of the scene file or model, if left out.

        Returns:
            The verdict; `.passed` is True if the scene moves as measured.

        Raises:
            SysidError: The scene cannot be built, or no decay can be compared in it.
        """
        from sim.board.bodies import TILT_JOINT
        from sim.gate import check_joint

        _, releases, _ = unpack(data)
        return check_joint(
            self, releases, tolerance=tolerance, scene_file=None if scene_file is None else Path(scene_file),
            scene_joint=scene_joint or TILT_JOINT, timestep=timestep,
        )[0]  # fmt: skip

    def to_mjcf(self, path: str | Path, *, bench: bool = False, timestep: float = 0.005) -> list[Path]:
        """Write the joint as MJCF: a model's joint into a copy of its model, a board as its scene.

        Args:
            path: XML file to write.
            bench: Of a board, only the deck on its joint, clamped.
            timestep: Step of a board's scene [s].

        Returns:
            The written files.

        Raises:
            SysidError: A number cannot be written, the copy does not load, or a board lacks geometry.
        """
        path = Path(path)
        if self.model:
            from sim.model.patch import patch
            from sim.model.setup import Setup

            return patch(Setup.of_entry(self.model), self).save(path)
        from sim.mjcf import board_mjcf

        if not bench:
            self.need("the scene of the whole board (not bench=True, the deck on its joint)")
        write_atomically(path, board_mjcf(self, "bench" if bench else "scene", timestep=timestep).xml)
        return [path]


class Board(Joint):
    """A joint with a board's geometry, for a training scene."""

    __slots__ = ()


def report(
    joint: records.Board,
    data: Data | None = None,
    path: str | Path = "report.html",
    *,
    diagnosis: "Diagnosis | None" = None,
    tolerance: float = 0.02,
) -> Path:
    """Write one HTML file with all results of a joint.

    Args:
        joint: The record.
        data: Recordings to show; the logs of the record's fit if left out.
        path: File to write.
        diagnosis: Result of `diagnose` for this record.
        tolerance: Largest error beyond the noise, over the RMS motion, of a comparison that passes [1].

    Returns:
        The file.

    Raises:
        SysidError: The logs cannot be compared with the record, or the file cannot be written.
    """
    from reports.evidence import LastDiagnosis, gather
    from reports.log_files import find_logs
    from reports.page.board import Provenance, board_report
    from reports.story import for_report

    space = Workspace(Path())
    records.require_record(joint)
    if data is None:
        files = find_logs(joint, [], space)
        recordings: Sequence[Recording] = [Recording.read(file.found) for file in files if file.found]
    else:
        recordings, _, _ = unpack(data)
        there = [one.path for one in recordings if one.path.exists()]
        files = find_logs(joint, there, space) if there else []
    found = None
    if diagnosis is not None:
        content: dict[str, Any] = {**diagnosis.to_json(), **for_report(diagnosis, joint)}
        found = LastDiagnosis(content, is_current=True)
    evidence = gather(joint, recordings, files=files, tolerance=tolerance) if recordings else None
    provenance = Provenance(
        command=f"sysid.report({shlex.quote(joint.name)})",
        made=date.today().isoformat(),
        record=joint.name,
        space=space,
    )
    path = Path(path)
    write_atomically(path, board_report(joint, evidence, files, provenance, found))
    return path
