"""Roll from films as phones and apps write them, of a scene of its own, against what MuJoCo moved in it.

    MUJOCO_GL=egl python benchmarks/video_phones.py

Nothing is shared with `tests/support/film.py` but the format of a row: another board, camera, light, texture and
background, MuJoCo's own joint and renderer, and ffmpeg. Writes benchmarks/results/video_phones.md.
"""

import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import mujoco
import numpy as np

from sysid.errors import SysidError
from sysid.free_decay import fit_decay
from sysid.quantity import Quantity
from sysid.releases import find_releases
from sysid.roll import Array, Roll
from sysid.video_roll import VideoOptions, roll_from_video

RESULTS = Path(__file__).parent / "results" / "video_phones.md"
WIDTH, HEIGHT, RATE, SECONDS = 960, 540, 120, 1.5
HELD = 0.25
"""Seconds for which the board is held, tilted."""
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
    <camera name="phone" fovy="26" pos="-1 .06 .08" xyaxes=".06 -1 0 .08 0 1"/>
    <body name="deck">
      <joint name="tilt" type="hinge" axis="1 0 0" stiffness="14.7" damping=".12"/>
      <geom type="box" size=".36 .11 .008" material="wood" mass="0"/>
      <geom type="box" size=".004 .11 .03" pos="-.36 0 .01" material="wood" mass="0"/>
      {mark}
      <inertial pos="0 0 0" mass="1" diaginertia=".0087 .05 .05"/>
    </body>
  </worldbody>
</mujoco>
"""
MARKS = {
    "marker": '<geom type="box" size=".001 .032 .032" pos="-.366 0 .07" material="card" mass="0"/>',
    "dots": '<geom type="sphere" size=".008" pos="-.365 .09 .02" rgba="1 .1 .6 1" mass="0"/>'
    '<geom type="sphere" size=".008" pos="-.365 -.09 .02" rgba="1 .1 .6 1" mass="0"/>',
    "features": "",
}
KINDS: dict[str, tuple[str, ...]] = {
    "H.264, 20 Mbit/s": ("-c:v", "libx264", "-b:v", "20M"),
    "HEVC, 10 bit": ("-c:v", "libx265", "-pix_fmt", "yuv420p10le", "-b:v", "10M", "-x265-params", "log-level=none"),
    "rotated by the container": ("-c:v", "libx264", "-b:v", "20M"),
    "trimmed by an edit list": ("-c:v", "libx264", "-b:v", "20M"),
    "variable rate": ("-c:v", "libx264", "-b:v", "20M"),
    "slow motion, rate noted": ("-c:v", "libx264", "-b:v", "20M"),
    "second generation": ("-c:v", "libx264", "-b:v", "4M"),
}  # fmt: skip


def main() -> None:
    rows: list[str] = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for mark in MARKS:
            time, roll = rendered(folder, mark)
            for kind in KINDS:
                line = row(mark, kind, written(folder, kind), time, roll)
                print(line, flush=True)
                rows.append(line)
    head = (
        "# Roll from films as phones write them\n\n`benchmarks/video_phones.py`: one board, let go once, in a scene of MuJoCo's own, "
        f"{WIDTH}x{HEIGHT} at {RATE} frames/s, written by ffmpeg. Without the clock's offset\nand the rest angle; k and d of `decay` "
        "against those of the model.\n\n| followed | film | RMSE [°] | 95 % covers | k off [%] | d off [%] | k, d held |\n|---|---|---|---|---|---|---|\n"
    )
    RESULTS.write_text(head + "\n".join(rows) + "\n")


def rendered(folder: Path, mark: str) -> tuple[Array, Array]:
    """Render the swing into a film without losses; return the truth [s, rad]."""
    cells = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), 3, 6)
    card = cv2.resize(np.pad(cells, 1, constant_values=255), (640, 640), interpolation=cv2.INTER_NEAREST)
    grain = cv2.GaussianBlur(np.random.default_rng(5).normal(size=(300, 1200, 1)), (0, 0), 12, sigmaY=4)
    wood = np.array([60, 100, 140]) + 900 * grain[..., None] * (mark == "features")
    files = {"card.png": card[:, ::-1], "wood.png": np.clip(wood, 0, 255).astype(np.uint8)}
    pictures = {name: cv2.imencode(".png", one)[1].tobytes() for name, one in files.items()}
    model = mujoco.MjModel.from_xml_string(SCENE.format(mark=MARKS[mark]), pictures)
    data = mujoco.MjData(model)
    time = np.arange(int(SECONDS / model.opt.timestep)) * model.opt.timestep
    roll = np.full(len(time), 0.35)
    data.qpos[0] = roll[0]
    for row in np.flatnonzero(time > HELD):
        mujoco.mj_step(model, data)
        roll[row] = data.qpos[0]
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{WIDTH}x{HEIGHT}",
               "-r", str(RATE), "-i", "-", "-c:v", "libx264", "-qp", "0", str(folder / "raw.mkv")]  # fmt: skip
    with (
        mujoco.Renderer(model, HEIGHT, WIDTH) as renderer,
        subprocess.Popen(command, stdin=subprocess.PIPE) as writer,
    ):
        assert writer.stdin is not None
        for at in np.arange(int(SECONDS * RATE)) / RATE:
            data.qpos[0] = np.interp(at, time, roll)
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera="phone")
            noise = np.random.default_rng(int(1e6 * at)).normal(0, 2, (HEIGHT, WIDTH, 1))
            writer.stdin.write(np.clip(renderer.render() + noise, 0, 255).astype(np.uint8).tobytes())
    return time, roll


def written(folder: Path, kind: str) -> Path:
    """Write the film as a phone or an app does."""
    path = folder / "film.mp4"
    after = KINDS[kind]
    if kind.startswith("variable"):
        after += ("-vf", "select='not(eq(mod(n,7),3))',setpts=PTS", "-fps_mode", "passthrough")
    ffmpeg("-i", folder / "raw.mkv", *after, path)
    if kind.startswith(("rotated", "second", "slow")):
        first = path.rename(folder / "first.mp4")
        if kind.startswith("slow"):
            noted = ("-movflags", "use_metadata_tags", "-metadata", f"com.android.capture.fps={RATE}.0")
            ffmpeg("-itsscale", RATE / 30, "-i", first, "-c", "copy", *noted, path)
        elif kind.startswith("rotated"):
            ffmpeg("-i", first, "-vf", "transpose=2", *after, folder / "turned.mp4")
            ffmpeg("-i", folder / "turned.mp4", "-c", "copy", "-metadata:s:v", "rotate=270", path)
        else:
            ffmpeg("-i", first, *after, path)
    if kind.startswith("trimmed"):
        data = bytearray(path.read_bytes())
        at = data.index(b"elst") + 12
        struct.pack_into(">I", data, at, round(0.8 * struct.unpack_from(">I", data, at)[0]))
        path.write_bytes(data)
    return path


def ffmpeg(*arguments: object) -> None:
    subprocess.run(["ffmpeg", "-y", "-loglevel", "error", *map(str, arguments)], check=True)


def row(mark: str, kind: str, film: Path, time: Array, truth: Array) -> str:
    """Read a film and compare it."""
    try:
        roll = roll_from_video(film, VideoOptions(method=mark, readout=0.0))
    except SysidError as error:
        return f"| {mark} | {kind} | refused: {str(error)[len(str(film)) + 2 :][:60]} | | | | |"
    error = min((against(roll, time, truth, at) for at in np.linspace(-0.02, 0.02, 401)), key=np.std)
    error = error - np.median(error[-20:])
    inside = np.mean(np.abs(error) < 1.96 * roll.std)
    inertia = Quantity(0.0087, 0.0, "kg*m^2")
    seen = fit_decay(find_releases(roll), inertia).numbers
    pairs = ((seen.stiffness, 14.7), (seen.damping, 0.12))
    held = sum(one.ci95[0] <= true <= one.ci95[1] for one, true in pairs)
    off = " | ".join(f"{100 * (one.value / true - 1):+.2f}" for one, true in pairs)
    rmse = np.degrees(np.sqrt(np.mean(error**2)))
    return f"| {mark} | {kind} | {rmse:.3f} | {100 * inside:.0f} % | {off} | {held} of 2 |"


def against(roll: Roll, time: Array, truth: Array, offset: float) -> Array:
    """Error of each sample [rad] where the clock is off by so many seconds."""
    return roll.roll - np.interp(roll.time + offset, time, truth)


if __name__ == "__main__":
    sys.exit(main())
