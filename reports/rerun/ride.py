# pyright: reportUnknownParameterType=false, reportAttributeAccessIssue=false
# (MuJoCo ships no type stubs.)
"""A ride or a reference motion as a Rerun recording."""

from pathlib import Path

import mujoco
import numpy as np

from policy_runtime.evaluation.recording import Recording
from policy_runtime.motion.motions import Motion
from reports.figures.palette import NOISE, REAL, SIM
from reports.rerun.stream import Look, body_entity, log_model, log_poses, log_series, log_states, recording
from sim.skate.cycle.clock import CONTROL_PERIOD, Clock
from sim.skate.robot.g1 import JOINTS
from sim.skate.world.scene import ROBOT
from sysid.roll import Array

BLACK = "#444444"


def ride_recording(model: mujoco.MjModel, ride: Recording, name: str, path: Path) -> None:
    """Write a recorded ride: the moving scene, speed, heading, tilt, contacts and phases."""
    import rerun as rr
    import rerun.blueprint as rrb

    views = rrb.Vertical(
        rrb.TimeSeriesView(origin="speed", name="speed [m/s]"),
        rrb.TimeSeriesView(origin="heading", name="heading [rad]"),
        rrb.TimeSeriesView(origin="tilt", name="deck roll [rad]"),
        rrb.TimeSeriesView(origin="contact", name="contacts"),
    )
    pelvis = f"world/{body_entity(model, model.body(f'{ROBOT}pelvis').id)}"
    scene = rrb.Spatial3DView(
        origin="world", name="ride", eye_controls=rrb.EyeControls3D(tracking_entity=pelvis)
    )
    blueprint = rrb.Blueprint(rrb.Horizontal(scene, views, column_shares=[3, 2]), collapse_panels=True)
    with recording(path, name, blueprint) as stream:
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log_model(stream, "world", model)
        log_poses(stream, "world", model, ride.column("time"), ride.column("qpos"))
        where = ride.column("board_position")
        stream.log("world/path", rr.LineStrips3D([where], colors=[(0, 114, 178)], radii=0.004), static=True)
        _ground(stream, where)
        for entity, values, label, colour in (
            ("speed/board", ride.column("board_speed"), "board", SIM),
            ("speed/commanded", ride.column("command")[:, 0], "commanded", BLACK),
            ("heading/board", np.unwrap(ride.column("board_heading")), "board", SIM),
            ("heading/target", ride.column("target_heading"), "target", BLACK),
            ("tilt/roll", ride.column("roll"), "deck roll", SIM),
            ("tilt/front_truck", ride.column("trucks")[:, 0], "front truck", REAL),
            ("contact/left_ground", ride.column("foot_on_ground")[:, 0] * 1.0, "left foot on ground", REAL),
            ("contact/left_deck", ride.column("foot_on_deck")[:, 0] * 0.9, "left foot on deck", SIM),
            ("contact/right_deck", ride.column("foot_on_deck")[:, 1] * 0.8, "right foot on deck", NOISE),
        ):
            log_series(
                stream, entity, ride.column("time"), np.asarray(values, dtype=float), Look(label, colour)
            )
        log_states(stream, "phase", _phases(ride))


def motion_recording(model: mujoco.MjModel, motions: list[Motion], path: Path) -> None:
    """Write reference motions side by side, one lane each, two metres apart."""
    import rerun as rr
    import rerun.blueprint as rrb

    series = [rrb.TimeSeriesView(origin=f"joints/{motion.name}", name=motion.name) for motion in motions]
    blueprint = rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(origin="world", name="motions"), rrb.Vertical(*series), column_shares=[2, 1]
        ),
        collapse_panels=True,
    )
    with recording(path, "motions", blueprint) as stream:
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for lane, motion in enumerate(motions):
            time = CONTROL_PERIOD * np.arange(len(motion.joints), dtype=np.float64)
            qpos = motion.qpos.copy()
            qpos[:, 1] -= 2.0 * lane
            log_model(stream, f"world/{motion.name}", model)
            log_poses(stream, f"world/{motion.name}", model, time, qpos)
            for joint, colour in (("left_hip_pitch", SIM), ("left_knee", REAL), ("right_knee", NOISE)):
                values = motion.joints[:, JOINTS.index(f"{joint}_joint")]
                log_series(stream, f"joints/{motion.name}/{joint}", time, values, Look(joint, colour))
        _ground(stream, np.vstack([motion.position for motion in motions]))


def _phases(ride: Recording) -> list[tuple[float, str]]:
    """Return when each phase of the cycle begins [s]."""
    clock, step = Clock(), ride.column("step")
    names = np.select(
        [clock.pushing(step), clock.mounting(step), clock.steering(step)],
        ["push", "mount", "steer"],
        "dismount",
    )
    changes = [0, *(np.flatnonzero(names[1:] != names[:-1]) + 1)]
    return [(float(ride.column("time")[i]), str(names[i])) for i in changes]


def _ground(stream: object, where: Array) -> None:
    """Log a grid of 1 m on the ground around where things happen."""
    import rerun as rr

    (x0, y0), (x1, y1) = np.floor(where[:, :2].min(axis=0)) - 2, np.ceil(where[:, :2].max(axis=0)) + 2
    lines = [[(x, y0, 0.0), (x, y1, 0.0)] for x in np.arange(x0, x1 + 1)]
    lines += [[(x0, y, 0.0), (x1, y, 0.0)] for y in np.arange(y0, y1 + 1)]
    grid = rr.LineStrips3D(lines, colors=[(130, 130, 130)], radii=0.002)
    stream.log("world/ground", grid, static=True)  # pyright: ignore[reportAttributeAccessIssue]
