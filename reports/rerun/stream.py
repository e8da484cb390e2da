"""Writing Rerun recordings: series, states and MuJoCo models that move.

Rerun logs mistakes as warnings and goes on; here every call is strict. A recording is written to a
temporary file and takes its place only when it is whole.
"""

import os
import re
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from reports.figures.palette import rgb
from sysid.errors import SysidError
from sysid.files import atomic_path
from sysid.roll import Array

if TYPE_CHECKING:
    import mujoco
    import rerun as rr
    import rerun.blueprint as rrb

APPLICATION = "husky-sysid"
"""First word of every application id. A viewer keeps the layout that it first saw of an application for
all its later files, so each recording is an application of its own."""
HEADROOM = 1_048_576
"""Free space that a recording needs to begin [B]."""
TIMELINE = "t"
"""Seconds; for a decay, since the first release."""


def need_rerun() -> None:
    """Check that recordings can be written, before long work.

    Raises:
        SysidError: rerun-sdk is not installed.
    """
    os.environ.setdefault("RUST_LOG", "off")  # the raised error is the only message
    try:
        import rerun
    except ImportError as error:
        raise SysidError("Rerun recordings need the package rerun-sdk: pip install rerun-sdk") from error
    del rerun


@contextmanager
def recording(path: Path, recording_id: str, blueprint: "rrb.Blueprint") -> "Generator[rr.RecordingStream]":
    """Open a recording that carries its own blueprint, and put it in place when the block succeeds.

    Raises:
        SysidError: rerun-sdk is not installed, or the path cannot be written.
    """
    need_rerun()
    import rerun as rr

    # Only letters that Rerun allows.
    application = re.sub(r"[^A-Za-z0-9_\- ]", "-", f"{APPLICATION} {recording_id}")
    was_strict = rr.strict_mode()
    rr.set_strict_mode(True)
    try:
        with (
            atomic_path(path) as temporary,
            rr.RecordingStream(application, recording_id=recording_id) as stream,
        ):
            temporary.write_bytes(bytes(HEADROOM))  # where its first write fails, Rerun waits for ever
            stream.save(temporary)
            stream.send_blueprint(blueprint, make_active=True, make_default=True)
            yield stream
            stream.flush()
            stream.disconnect()
    except RuntimeError as error:
        if "writ" not in str(error):
            raise
        raise SysidError(f"{path}: cannot be written ({error}). Is the disk full?") from error
    finally:
        rr.set_strict_mode(was_strict)


class Look(NamedTuple):
    """Style of a curve."""

    name: str
    """Shown in the legend."""
    colour: str
    """'#RRGGBB'."""
    width: float = 1.5
    """[points]."""


def log_series(stream: "rr.RecordingStream", entity: str, time: Array, values: Array, look: Look) -> None:
    """Log a curve with its style: values over the recording's time line [s], shape (n,) each."""
    import rerun as rr

    style = rr.SeriesLines(colors=[rgb(look.colour)], names=[look.name], widths=[look.width])
    stream.log(entity, style, static=True)
    times = rr.TimeColumn(TIMELINE, duration=time)
    stream.send_columns(entity, indexes=[times], columns=rr.Scalars.columns(scalars=values))


def log_states(
    stream: "rr.RecordingStream",
    entity: str,
    states: Sequence[tuple[float, str]],
    colours: Mapping[str, str] | None = None,
) -> None:
    """Log a lane of states: each holds from its time [s] until the next; '#RRGGBB' by state if given."""
    import rerun as rr

    if colours:
        style = rr.StateConfiguration(values=list(colours), colors=[rgb(c) for c in colours.values()])
        stream.log(entity, style, static=True)
    for time, state in states:
        stream.set_time(TIMELINE, duration=time)
        stream.log(entity, rr.StateChange(state=state))
    stream.reset_time()


def log_model(
    stream: "rr.RecordingStream",
    root: str,
    model: "mujoco.MjModel",
    *,
    tint: str | None = None,
    alpha: float = 1.0,
) -> None:
    """Log the shapes of a MuJoCo model once, each under the entity of its body (see `log_poses`).

    Args:
        root: Entity under which the model stands.
        model: Compiled model; infinite planes are left out.
        tint: '#RRGGBB' for all shapes instead of their own colours.
        alpha: Opacity, for ghosts.
    """
    import rerun as rr
    from mujoco import mjtGeom

    for geom in range(model.ngeom):
        entity = f"{root}/{body_entity(model, int(model.geom_bodyid[geom]))}/geom{geom}"
        own = model.geom_rgba[geom]
        if own[3] == 0 or model.geom_group[geom] >= 3:  # collision shapes of a robot hide in group 3
            continue
        base = rgb(tint) if tint else tuple(int(255 * c) for c in own[:3])
        colour = (*base, int(255 * alpha * own[3]))
        size = model.geom_size[geom]
        solid: dict[str, Any] = {"colors": [colour], "fill_mode": "solid"}
        place = rr.Transform3D(
            translation=model.geom_pos[geom],
            quaternion=rr.Quaternion(xyzw=np.roll(model.geom_quat[geom], -1)),
        )
        shape: rr.AsComponents
        match mjtGeom(model.geom_type[geom]):
            case mjtGeom.mjGEOM_BOX:
                shape = rr.Boxes3D(half_sizes=[size], **solid)
            case mjtGeom.mjGEOM_SPHERE:
                shape = rr.Ellipsoids3D(radii=[size[0]], **solid)
            case mjtGeom.mjGEOM_CYLINDER:
                shape = rr.Cylinders3D(lengths=[2 * size[1]], radii=[size[0]], **solid)
            case mjtGeom.mjGEOM_CAPSULE:
                # Rerun's capsule starts at the origin and goes along +z; MuJoCo's is centred.
                low = [(0, 0, -size[1])]
                shape = rr.Capsules3D(lengths=[2 * size[1]], radii=[size[0]], translations=low, **solid)
            case mjtGeom.mjGEOM_MESH:
                mesh = int(model.geom_dataid[geom])
                vertex, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
                shape = rr.Mesh3D(
                    vertex_positions=model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]],
                    triangle_indices=model.mesh_face[face : face + model.mesh_facenum[mesh]],
                    albedo_factor=colour,
                )
            case _:
                continue
        stream.log(entity, place, shape, static=True)


def log_poses(
    stream: "rr.RecordingStream", root: str, model: "mujoco.MjModel", time: Array, positions: npt.ArrayLike
) -> None:
    """Log how the bodies of a model, logged under that root, move.

    Generalised positions qpos are of shape (n, nq), over the recording's time line [s], shape (n,).
    """
    import mujoco
    import rerun as rr

    data = mujoco.MjData(model)
    rows = np.atleast_2d(np.asarray(positions, dtype=float))
    translations = np.empty((len(rows), model.nbody, 3))
    quaternions = np.empty((len(rows), model.nbody, 4))
    for i, row in enumerate(rows):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        translations[i] = data.xpos
        quaternions[i] = np.roll(data.xquat, -1, axis=1)  # MuJoCo wxyz, Rerun xyzw
    times = rr.TimeColumn(TIMELINE, duration=time)
    for body in range(1, model.nbody):
        moves = rr.Transform3D.columns(translation=translations[:, body], quaternion=quaternions[:, body])
        stream.send_columns(f"{root}/{body_entity(model, body)}", indexes=[times], columns=moves)


def log_summary(stream: "rr.RecordingStream", text: str) -> None:
    """Log a text in Markdown."""
    import rerun as rr

    stream.log("summary", rr.TextDocument(text, media_type="text/markdown"), static=True)


def body_entity(model: "mujoco.MjModel", body: int) -> str:
    """Return the entity name of a body: flat, since logged poses are in the world's frame."""
    return (model.body(body).name or f"body{body}").replace("/", "-")
