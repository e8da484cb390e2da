"""Roll from films as phones and apps write them, of a scene of its own, against what MuJoCo moved in it.

    MUJOCO_GL=egl python benchmarks/video_phones.py [--rows DIR] [--only dots] [--films "second generation"] [--seconds 3600]

Nothing is shared with `tests/support/film.py` but the mark that a phone was held upright: another board, camera, light, texture and
background, MuJoCo's own joint and renderer, and ffmpeg. Nothing is told to the tool. A row that was read is kept in DIR
and used again. Writes benchmarks/results/video_phones.md and the table of docs/video.md.
"""

import argparse
import json
import struct
import subprocess
import sys
import tempfile
import time as clock
from dataclasses import dataclass
from pathlib import Path

import cv2
import mujoco
import numpy as np
from pages import table, write_between, write_result

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from film_container import turned

from sysid.errors import SysidError
from sysid.free_decay import fit_decay
from sysid.quantity import Quantity
from sysid.releases import find_releases
from sysid.roll import Array, Roll
from sysid.video_roll import VideoOptions, roll_from_video

PAGE = Path(__file__).parents[1] / "docs" / "video.md"
WIDTH, HEIGHT, RATE, SECONDS = 960, 540, 120, 1.5
HELD = 0.25
"""Seconds for which the board is held, tilted."""
INERTIA, STIFFNESS, DAMPING = 0.0087, 14.7, 0.12
"""Of the joint [kg m², N m/rad, N m s/rad]."""
PAN = np.radians(0.5)
"""How far the camera turns aside and up from frame to last frame [rad]."""
SCENE = """
<mujoco>
  <option timestep="0.0005" integrator="RK4" gravity="0 0 0"/>
  <visual><global offwidth="1920" offheight="1080"/><headlight ambient=".4 .4 .4"/></visual>
  <asset>
    <texture name="wall" type="2d" builtin="gradient" mark="random" random=".06" rgb1=".62 .6 .55" rgb2=".5 .52 .56"
      markrgb=".3 .3 .35" width="900" height="900"/>
    <texture name="wood" type="2d" file="wood.png"/>
    <texture name="card" type="2d" file="card.png"/>
    <material name="wall" texture="wall"/> <material name="wood" texture="wood"/> <material name="card" texture="card"/>
  </asset>
  <worldbody>
    <light pos="-1 .6 1.5" dir=".6 -.4 -1" castshadow="false"/>
    <geom type="plane" size="3 3 1" pos="1.4 0 0" zaxis="-1 0 0" material="wall"/>
    <geom type="box" size=".35 .03 .02" pos=".1 0 -.09" rgba=".35 .35 .38 1"/>
    <camera name="phone" fovy="26" pos="-1 .06 {height}" xyaxes=".06 -1 0 {height} 0 1"/>
    <body name="hand" mocap="true" pos="-.5 -.5 -.5">
      <geom type="capsule" size=".022" fromto="0 0 0 0 .1 -.2" rgba=".75 .55 .45 1"/>
      <geom type="sphere" size=".035" rgba=".75 .55 .45 1"/>
    </body>
    <body name="deck">
      <joint name="tilt" type="hinge" axis="1 0 0" stiffness="{stiffness}" damping="{damping}"/>
      <geom type="box" size=".36 {half} .008" material="wood" mass="0"/>
      <geom type="box" size=".004 {half} {lip}" pos="-.36 0 {lip}" material="wood" mass="0"/>
      {mark}
      <inertial pos="0 0 0" mass="1" diaginertia="{inertia} .05 .05"/>
    </body>
  </worldbody>
</mujoco>
"""


@dataclass(frozen=True)
class Board:
    """What is on the deck, and from how high it is filmed."""

    mark: str = ""
    painted: bool = False
    half_width: float = 0.11
    lip: float = 0.01
    """Half the height of the deck's end [m]."""
    camera_height: float = 0.08
    camera_angle: tuple[float, float] | None = None
    """What is told to the tool: how far the axis is to the right of and below the line of sight [rad]."""


BOARDS = {
    "marker": Board('<geom type="box" size=".001 .032 .032" pos="-.366 0 .07" material="card" mass="0"/>'),
    "small marker, wide deck": Board(
        '<geom type="box" size=".001 .018 .018" pos="-.366 .03 .05" material="card" mass="0"/>',
        half_width=0.15,
    ),
    "two stickers": Board(
        '<geom type="sphere" size=".008" pos="-.365 .09 .02" rgba="1 .1 .6 1" mass="0"/>'
        '<geom type="sphere" size=".008" pos="-.365 -.09 .02" rgba="1 .1 .6 1" mass="0"/>'
    ),
    "prints": Board(painted=True, lip=0.03),
    "bare edge": Board(camera_height=0.0),
    "bare edge, --camera-angle 3.4 0": Board(camera_height=0.0, camera_angle=(float(np.radians(3.4)), 0.0)),
}
H264 = ("-c:v", "libx264", "-preset", "veryfast", "-b:v", "12M")
FILMS: dict[str, tuple[str, tuple[str, ...]]] = {
    "H.264": ("", H264),
    "HEVC": ("", ("-c:v", "libx265", "-preset", "fast", "-b:v", "8M", "-x265-params", "log-level=none")),
    "HEVC, 10 bit": (
        "", ("-c:v", "libx265", "-preset", "fast", "-pix_fmt", "yuv420p10le", "-b:v", "8M", "-x265-params", "log-level=none")
    ),
    "variable rate": (
        "", (*H264, "-vf", "select='not(eq(mod(n,7),3))',setpts=PTS+mod(N*7\\,5)/5*0.002/TB", "-fps_mode", "passthrough")
    ),
    "second generation, 4 Mbit/s": ("", H264),
    "turned by the container": ("", H264),
    "trimmed by an edit list": ("", H264),
    "slow motion, rate noted": ("", H264),
    "automatic exposure": ("", (*H264, "-vf", "eq=contrast='1+0.4*clip((t-0.5)/0.4,0,1)':eval=frame")),
    "hand before the deck for 80 ms": ("hand", H264),
    "camera turns by 0.5°": ("pan", H264),
}  # fmt: skip
"""What is filmed, and how it is written."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=Path, default=Path(tempfile.gettempdir()) / "husky-phones")
    parser.add_argument("--only", choices=BOARDS, action="append")
    parser.add_argument("--films", default="")
    parser.add_argument("--seconds", type=float, default=np.inf, help="start no more rows after so long")
    arguments = parser.parse_args()
    arguments.rows.mkdir(parents=True, exist_ok=True)
    latest = clock.monotonic() + arguments.seconds
    for film in FILMS:
        for board in BOARDS:
            kept = arguments.rows / file_name(board, film)
            asked = board in (arguments.only or BOARDS) and arguments.films in film
            if asked and not kept.exists() and clock.monotonic() < latest:
                with tempfile.TemporaryDirectory() as place:
                    raw, truth = rendered(arguments.rows, board, FILMS[film][0])
                    kept.write_text(json.dumps(row(board, film, written(Path(place), raw, film), truth)))
                print(kept.read_text(), flush=True)
    cells = [json.loads(file.read_text()) for file in done(arguments.rows)]
    write(cells)


def file_name(board: str, film: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in f"{board}-{film}") + ".json"


def done(folder: Path) -> list[Path]:
    """Return the rows that are kept, in the table's order."""
    files = [folder / file_name(board, film) for board in BOARDS for film in FILMS]
    return [file for file in files if file.exists()]


def rendered(folder: Path, name: str, event: str) -> tuple[Path, Array]:
    """Render the swing into a film that loses next to nothing, unless it is there; return it and the roll [s, rad], shape (2, n)."""
    cells = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 3, 6)
    card = cv2.resize(np.pad(cells, 1, constant_values=255), (640, 640), interpolation=cv2.INTER_NEAREST)
    board = BOARDS[name]
    grain = cv2.GaussianBlur(np.random.default_rng(5).normal(size=(300, 1200, 1)), (0, 0), 12, sigmaY=4)
    wood = np.array([60, 100, 140]) + 900 * grain[..., None] * board.painted
    files = {"card.png": card[:, ::-1], "wood.png": np.clip(wood, 0, 255).astype(np.uint8)}
    pictures = {name: cv2.imencode(".png", one)[1].tobytes() for name, one in files.items()}
    scene = SCENE.format(
        mark=board.mark, half=board.half_width, lip=board.lip, height=board.camera_height, inertia=INERTIA,
        stiffness=STIFFNESS, damping=DAMPING,
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(scene, pictures)
    data = mujoco.MjData(model)
    time = np.arange(int(SECONDS / model.opt.timestep)) * model.opt.timestep
    roll = np.full(len(time), 0.35)
    data.qpos[0] = roll[0]
    for step in np.flatnonzero(time > HELD):
        mujoco.mj_step(model, data)
        roll[step] = data.qpos[0]
    path = folder / file_name(name, event).replace(".json", ".mkv")
    if not path.exists():
        unfinished = path.with_suffix(".part.mkv")
        render(model, data, time, roll, event, unfinished)
        unfinished.rename(path)
    return path, np.stack([time, roll])


def render(
    model: mujoco.MjModel, data: mujoco.MjData, time: Array, roll: Array, event: str, path: Path
) -> None:
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{WIDTH}x{HEIGHT}",
               "-r", str(RATE), "-i", "-", "-c:v", "libx264", "-preset", "ultrafast", "-qp", "1", str(path)]  # fmt: skip
    look = model.cam_quat[0].copy()
    rng = np.random.default_rng(1)
    with (
        mujoco.Renderer(model, HEIGHT, WIDTH) as renderer,
        subprocess.Popen(command, stdin=subprocess.PIPE) as writer,
    ):
        assert writer.stdin is not None
        for at in np.arange(int(SECONDS * RATE)) / RATE:
            data.qpos[0] = np.interp(at, time, roll)
            if event == "pan":
                turn = np.zeros(4)
                mujoco.mju_euler2Quat(turn, PAN * at / SECONDS * np.array([0.5, 1.0, 0.2]), "xyz")
                mujoco.mju_mulQuat(model.cam_quat[0], look, turn)
            if event == "hand" and 0.6 < at < 0.68:
                data.mocap_pos[0] = [-0.45, -0.04 + (at - 0.6), -0.02]
            elif event == "hand":
                data.mocap_pos[0] = [-0.5, -0.5, -0.5]
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera="phone")
            noise = rng.normal(0, 2, (HEIGHT, WIDTH, 1))
            writer.stdin.write(np.clip(renderer.render() + noise, 0, 255).astype(np.uint8).tobytes())


def written(folder: Path, raw: Path, film: str) -> Path:
    """Write the film as a phone or an app does."""
    path, after = folder / "film.mp4", FILMS[film][1]
    if film.startswith("turned"):
        ffmpeg("-i", raw, "-vf", "transpose=2", *after, folder / "turned.mp4")
        turned(folder / "turned.mp4", path, 90)  # newer ffmpegs ignore "-metadata rotate"
        return path
    ffmpeg("-i", raw, *after, path)
    if film.startswith("second"):
        first = path.rename(folder / "first.mp4")
        ffmpeg("-i", first, *H264[:-1], "4M", path)
    elif film.startswith("slow"):
        first = path.rename(folder / "first.mp4")
        noted = ("-movflags", "use_metadata_tags", "-metadata", f"com.android.capture.fps={RATE}.0")
        ffmpeg("-itsscale", RATE / 30, "-i", first, "-c", "copy", *noted, path)
    elif film.startswith("trimmed"):
        data = bytearray(path.read_bytes())
        at = data.index(b"elst") + 12
        struct.pack_into(">I", data, at, round(0.8 * struct.unpack_from(">I", data, at)[0]))
        path.write_bytes(data)
    return path


def ffmpeg(*arguments: object) -> None:
    subprocess.run(["ffmpeg", "-y", "-loglevel", "error", *map(str, arguments)], check=True)


def row(board: str, name: str, film: Path, truth: Array) -> list[str]:
    """Read a film and compare it; return the cells of the table."""
    try:
        roll = roll_from_video(film, VideoOptions(camera_angle=BOARDS[board].camera_angle))
    except SysidError as error:
        return [board, name, f"refused: {str(error).removeprefix(f'{film}: ')[:80]}", *[""] * 6]
    error = min((against(roll, truth, at) for at in np.linspace(-0.02, 0.02, 401)), key=np.std)
    rest = float(np.median(error[-20:]))
    error = error - rest
    follows = next(note for note in roll.notes if note.startswith("follows: "))
    inside = np.mean(np.abs(error) < 1.96 * roll.std)
    rmse = np.degrees(np.sqrt(np.mean(error**2)))
    cells = [board, name, follows[9:].split(":")[0].split(";")[0], f"{rmse:.3f}", f"{np.degrees(rest):+.2f}"]
    cells.append(f"{100 * inside:.0f} %")
    try:
        seen = fit_decay(find_releases(roll), Quantity(INERTIA, 0.0, "kg*m^2")).numbers
    except SysidError as error:
        return [*cells, f"refused: {str(error)[:60]}", "", ""]
    pairs = ((seen.stiffness, STIFFNESS), (seen.damping, DAMPING))
    held = sum(one.ci95[0] <= true <= one.ci95[1] for one, true in pairs)
    return [*cells, *(f"{100 * (one.value / true - 1):+.2f}" for one, true in pairs), f"{held} of 2"]


def against(roll: Roll, truth: Array, offset: float) -> Array:
    """Error of each sample [rad] where the clock is off by so many seconds."""
    return roll.roll - np.interp(roll.time + offset, *truth)


def write(rows: list[list[str]]) -> None:
    """Write the whole table, and what people look for in the page."""
    titles = [
        "on the deck", "film", "what was followed", "RMSE [°]", "level off [°]", "95 % covers", "k off [%]", "d off [%]",
        "k, d held",
    ]  # fmt: skip
    held = [int(cells[-1][0]) for cells in rows if cells[-1]]
    write_result(
        "video_phones.md",
        f"""# Roll from films as phones write them

`benchmarks/video_phones.py`: boards of k {STIFFNESS} N*m/rad and d {DAMPING} N*m*s/rad, let go once, in a scene of MuJoCo's own, {WIDTH}x{HEIGHT} at {RATE} frames/s,
written by ffmpeg at 12 (H.264) or 8 Mbit/s (HEVC); nothing is told to the tool but the file, and in the last rows the axis' direction. RMSE without the clock's offset and
the level; k and d of `decay` against those of the model, and whether their 95 % intervals hold them: {sum(held)} of {2 * len(held)} in all.

{table(titles, rows)}""",
    )
    titles = ["on the deck", "RMSE, median [°]", "largest [°]", "damping off, median [%]", "largest [%]"]
    write_between(PAGE, "phones", table(titles, [summary(board, rows) for board in BOARDS]))


def summary(board: str, rows: list[list[str]]) -> list[str]:
    """Return the median and the largest errors of a board over its films, for the page."""
    read = [cells for cells in rows if cells[0] == board and cells[7]]
    rmse, damping = ([abs(float(cells[k])) for cells in read] for k in (3, 7))
    return [
        board,
        *(f"{error:.3f}" for error in (np.median(rmse), max(rmse))),
        *(f"{error:.2f}" for error in (np.median(damping), max(damping))),
    ]


if __name__ == "__main__":
    sys.exit(main())
