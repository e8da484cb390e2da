"""The set of a test film: the board from behind, a wall, a floor and a hand, with the roll prescribed.

The deck's tilt is a hinge about +x with the board's identified inertia, spring and damper; the same
model makes the motion (`rock`) and is what the camera of `film` sees.
"""

from dataclasses import dataclass
from typing import Literal

import cv2
import mujoco
import numpy as np

from sysid.board import Board
from sysid.roll import Array

Mark = Literal["marker", "dots", "edge", "none"]

MARKER_ID = 7
MARKER_SIDE = 0.07
"""Side of the black square on the card at the deck's end [m]; the card is 9/7 as wide."""
DOT_DISTANCE = 0.15
"""Distance of the two stickers on the deck's end [m]."""
STEP = 2e-4
HAND_AWAY = (-0.3, -0.9, 0.3)


@dataclass(frozen=True, slots=True)
class Motion:
    """A known roll against time, fine enough for linear interpolation."""

    time: Array
    """Time [s], shape (n,)."""
    roll: Array
    """Roll [rad], shape (n,)."""

    def at(self, time: Array) -> Array:
        """Return the roll at `time` [s]; it is constant before the first and after the last sample."""
        return np.interp(time, self.time, self.roll)


def rock(board: Board, duration: float, releases: tuple[tuple[float, float], ...] = ((0.3, 0.4),)) -> Motion:
    """Tip the board by hand and let it go, one or several times: its roll inertia, stiffness and damping govern the free decays.

    A hand brings the deck to each release's roll [rad] within a quarter of a second and holds it until its time [s]. The motion is in steps of 0.2 ms, by RK4: exact to 1e-8 rad at the frequencies of a board.
    """
    # Without the set: its textures take longer to make than the motion.
    bare = f'<mujoco><option gravity="0 0 0"/><worldbody><body>{_tilt(board)}</body></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(bare)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.timestep = STEP
    data = mujoco.MjData(model)
    time = np.arange(round(duration / STEP) + 1) * STEP
    roll = np.zeros(len(time))
    starts = [round(start / STEP) for start, _ in releases]
    for number, (start, (_, angle)) in enumerate(zip(starts, releases, strict=True)):
        grip = max(start - round(0.4 / STEP), 0)
        ease = np.clip((np.arange(grip, start) - grip) * STEP / 0.25, 0, 1)
        before = roll[grip] if number else angle
        roll[grip:start] = before + (angle - before) * (1 - np.cos(np.pi * ease)) / 2
        if not number:
            roll[:start] = angle
        mujoco.mj_resetData(model, data)
        data.qpos[0] = angle
        for index in range(start, starts[number + 1] if number + 1 < len(starts) else len(time)):
            roll[index] = data.qpos[0]
            mujoco.mj_step(model, data)
    return Motion(np.asarray(time, np.float64), roll)


def _tilt(board: Board) -> str:
    """Return the deck's hinge and inertia as MJCF."""
    return (
        f'<joint name="board_tilt_joint" axis="1 0 0" stiffness="{board.stiffness}" damping="{board.damping}"/>'
        f'<inertial pos="0 0 0" mass="{board.mass["deck"].value}" diaginertia="{board.inertia.value} 0.1 0.1"/>'
    )


def film_xml(board: Board, mark: Mark) -> str:
    """Return the set as MJCF: x forward, the camera behind; the mark is on the deck's end."""
    size = {name: quantity.value for name, quantity in board.geometry.items()}
    half = (size["length"] / 2, size["width"] / 2, size["thickness"] / 2)
    axis = size["wheel_radius"] + size["truck_height"]
    end = -half[0] - 0.001
    marks = {
        "marker": f'<geom type="box" size="0.001 0.045 0.045" material="card" pos="{end} 0 {half[2] + 0.045}"/>',
        "dots": "".join(
            f'<geom type="cylinder" size="0.011 0.001" quat="0.7071068 0 0.7071068 0" '
            f'pos="{end} {side * DOT_DISTANCE / 2} 0.012" rgba="0.95 0.1 0.45 1"/>'
            for side in (-1, 1)
        )
        + f'<geom type="box" size="0.001 {half[1]} 0.018" pos="{end + 0.001} 0 0.012" rgba="0.75 0.75 0.7 1"/>',
        "edge": "",
        "none": f'<geom type="box" size="0.001 {half[1]} 0.035" material="plate" pos="{end} 0 0.01"/>',
    }
    trucks = "".join(
        f'<geom type="box" size="0.03 {size["track"] / 2} 0.01" pos="{x} 0 {size["wheel_radius"]}" rgba="0.5 0.5 0.55 1"/>'
        f'<geom type="box" size="0.02 0.02 {size["truck_height"] / 2}" pos="{x} 0 {axis - size["truck_height"] / 2}" rgba="0.4 0.4 0.45 1"/>'
        + "".join(
            f'<geom type="cylinder" size="{size["wheel_radius"]} 0.016" quat="0.7071068 0.7071068 0 0" '
            f'pos="{x} {side * size["track"] / 2} {size["wheel_radius"]}" rgba="0.9 0.85 0.7 1"/>'
            for side in (-1, 1)
        )
        for x in (-size["wheelbase"] / 2, size["wheelbase"] / 2)
    )
    shine = {"wall": 0.5, "floor": 0.5, "deck": 0.1, "card": 0.05, "plate": 0.05}
    textures = "".join(
        f'<texture name="{name}" type="2d" file="{name}.png"/>'
        f'<material name="{name}" texture="{name}" specular="{specular}"/>'
        for name, specular in shine.items()
    )
    return f"""
<mujoco>
  <option gravity="0 0 0"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <visual>
    <quality shadowsize="1024" offsamples="4"/>
    <global offwidth="3840" offheight="2160"/>
    <headlight ambient="0.35 0.35 0.35" diffuse="0.35 0.35 0.35" specular="0 0 0"/>
  </visual>
  <asset>
    {textures}
  </asset>
  <worldbody>
    <light pos="-1.5 1.0 2.0" dir="0.6 -0.4 -0.8" diffuse="0.5 0.5 0.5" specular="0.1 0.1 0.1" castshadow="false"/>
    <geom type="plane" size="4 4 0.1" material="floor"/>
    <geom type="plane" size="1.5 3 0.1" material="wall" pos="1.2 0 1" xyaxes="0 0 1 0 1 0"/>
    {trucks}
    <body name="hand" mocap="true" pos="{HAND_AWAY[0]} {HAND_AWAY[1]} {HAND_AWAY[2]}">
      <geom type="capsule" size="0.022" fromto="0 0 0 0 -0.5 0.12" rgba="0.85 0.62 0.5 1"/>
      <geom type="ellipsoid" size="0.03 0.05 0.03" rgba="0.85 0.62 0.5 1"/>
    </body>
    <body name="deck" pos="0 0 {axis}">
      {_tilt(board)}
      <geom type="box" size="{half[0]} {half[1]} {half[2]}" material="deck"/>
      {marks[mark]}
    </body>
  </worldbody>
</mujoco>"""


def film_textures(mark: Mark) -> dict[str, bytes]:
    """Return the textures of the set as PNG files; the same in every film."""
    rng = np.random.default_rng(20260)
    marker = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50).generateImageMarker(MARKER_ID, 700)
    card = np.full((900, 900, 3), 245, np.uint8)
    card[100:800, 100:800] = marker[:, ::-1, None]  # MuJoCo shows it from inside the box
    deck = _blotches(rng, (512, 512), (60, 95, 150), 1.0)
    pictures = {
        "wall": _blotches(rng, (2048, 2048), (150, 150, 140), 0.35),
        "floor": _blotches(rng, (2048, 2048), (95, 105, 110), 0.45),
        "deck": deck if mark == "none" else np.full_like(deck, (45, 65, 105)),
        "card": card,
        "plate": _blotches(rng, (256, 768), (70, 120, 160), 1.0),
    }
    files: dict[str, bytes] = {}
    for name, picture in pictures.items():
        _, encoded = cv2.imencode(".png", picture)
        files[f"{name}.png"] = encoded.tobytes()
    return files


def _blotches(
    rng: np.random.Generator, shape: tuple[int, int], colour: tuple[int, int, int], contrast: float
) -> np.ndarray:
    """Return a picture with detail at every size, like stickers, wood or plaster."""
    picture = np.zeros((*shape, 3))
    for octave in range(3, 10):
        cells = tuple(max(2, round(side / max(shape) * 2**octave)) for side in shape)
        noise = 0.3 * rng.normal(size=(*cells, 3)) + rng.normal(size=(*cells, 1))
        picture += cv2.resize(noise, shape[::-1], interpolation=cv2.INTER_CUBIC)
    picture *= 45 * contrast / picture.std()
    return np.clip(picture + np.array(colour), 0, 255).astype(np.uint8)
