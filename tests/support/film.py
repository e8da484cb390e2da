"""Films a board whose roll is known: test clips with the faults of a real camera.

Every frame is a time integral: the set is rendered at as many instants across the exposure (and,
with a rolling shutter, across the read-out) as the motion takes, and each row of the picture is the mean
over its own exposure. Camera shake is a rotation of the camera about its centre, which for a picture is an exact
homography. Lens, noise and compression follow in the order in which they happen in a camera.
"""

import json
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import mujoco
import numpy as np
import numpy.typing as npt
from film_container import film_writer
from film_set import HAND_AWAY, Mark, Motion, film_textures, film_xml

from sysid.board import Board
from sysid.files import atomic_path
from sysid.roll import Array
from sysid.video.film.camera import Lens

Picture = npt.NDArray[np.uint8]
Exposed = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A camera behind the board and its faults; the defaults are a good camera on a tripod."""

    width: int = 1280
    height: int = 720
    fps: float = 60.0
    focal: float = 1.25
    """Focal length in picture widths: 1.25 is a field of view of 44 degrees."""
    distance: float = 1.0
    """Distance of the lens from the deck's end [m]."""
    yaw_deg: float = 0.0
    """The camera stands to the left of the board's axis by this angle."""
    pitch_deg: float = 8.0
    """The camera looks down on the board by this angle."""
    roll_deg: float = 0.0
    """The camera's own tilt: the horizon falls to the left of the picture."""
    exposure: float = 1 / 500
    """Exposure of a row [s]."""
    readout: float = 0.0
    """Time from the first to the last row [s]; 0 is a global shutter."""
    shake_deg: float = 0.0
    """Standard deviation of the camera's rotation about each axis, at 1–4 Hz."""
    distortion: float = 0.0
    """First radial coefficient k1 of the lens (OpenCV's convention)."""
    noise: float = 1.5
    """Sensor noise in grey levels of 255, standard deviation."""
    jitter: float = 0.0
    """Standard deviation of the frame interval, as a share of it; the stamps say the truth."""
    hand: tuple[float, float] | None = None
    """Time span [s] in which a hand sweeps through the picture in front of the board."""
    step: float = 1.5
    """Farthest that a point moves from one rendering of a frame to the next [px]."""
    bits: float = 0.18
    """Bits a pixel of an H.264 film, on average: a phone's 1920x1080 at 60 frames/s takes 23 Mbit/s."""
    samples: int = 2
    """Renderings are this many times finer than the picture: a pixel is a mean, not a point."""

    @property
    def matrix(self) -> Array:
        """Camera matrix of the picture [px], shape (3, 3)."""
        f = self.focal * self.width
        return np.array([[f, 0, (self.width - 1) / 2], [0, f, (self.height - 1) / 2], [0, 0, 1]])


def film(path: Path, board: Board, motion: Motion, mark: Mark, camera: Camera, *, seed: int = 0) -> Array:
    """Film `motion` from behind and write it as a clip: .mp4 or .mov (H.264), or .avi (Motion JPEG).

    The seed is that of noise, shake and jitter.

    Returns:
        Time of the middle of the exposure of each frame's first row [s], shape (n,); the container's
        stamps are these less the first.
    """
    rng = np.random.default_rng(seed)
    stamps = frame_times(camera, motion.time[-1], rng)
    turns = shake(camera, stamps, rng)
    lens = _lens(camera) if camera.distortion != 0 else None
    size = (camera.width, camera.height)
    with (
        atomic_path(path) as temporary,
        _stage(board, mark, camera) as stage,
        film_writer(temporary, size, stamps, camera.bits, camera.fps) as write,
    ):
        for stamp, turn in zip(stamps, turns, strict=True):
            write(_develop(stage.expose(stamp, motion), turn, lens, camera, rng))
    return stamps


def write_calibration(lens: Lens, size: tuple[int, int]) -> str:
    """Return a calibration of pictures of this width and height [px] as the JSON text that `lens_of` reads."""
    numbers = {"camera_matrix": lens.matrix.tolist(), "distortion_coefficients": lens.distortion.tolist()}
    return json.dumps({"image_width": size[0], "image_height": size[1], **numbers})


def frame_times(camera: Camera, duration: float, rng: np.random.Generator) -> Array:
    """Return the time of each frame [s], in whole milliseconds if the rate varies (as phones do)."""
    margin = camera.readout + camera.exposure
    count = int((duration - 2 * margin) * camera.fps)
    steps = np.full(count, 1 / camera.fps)
    if camera.jitter > 0:
        steps = np.round(steps * (1 + camera.jitter * rng.normal(size=count)).clip(0.4, 3), 4)
    return camera.exposure + np.cumsum(steps) - steps[0]


def shake(camera: Camera, stamps: Array, rng: np.random.Generator) -> Array:
    """Return the camera's rotation vector [rad] at each frame, shape (n, 3): sums of slow waves."""
    turns = np.zeros((len(stamps), 3))
    for axis in range(3):
        for frequency, phase in zip(rng.uniform(1, 4, 4), rng.uniform(0, 2 * np.pi, 4), strict=True):
            turns[:, axis] += np.sin(2 * np.pi * frequency * stamps + phase) / np.sqrt(2)
    return np.radians(camera.shake_deg) * turns


def _develop(
    picture: Exposed,
    turn: Array,
    lens: tuple[Exposed, Exposed] | None,
    camera: Camera,
    rng: np.random.Generator,
) -> Picture:
    if camera.shake_deg > 0:
        matrix = camera.matrix
        homography = matrix @ cv2.Rodrigues(turn)[0] @ np.linalg.inv(matrix)
        size, border = (camera.width, camera.height), cv2.BORDER_REPLICATE
        picture = cv2.warpPerspective(picture, homography, size, flags=cv2.INTER_CUBIC, borderMode=border)
    if lens is not None:
        picture = cv2.remap(picture, *lens, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    picture = cv2.GaussianBlur(picture, (0, 0), 0.6)  # the lens is not sharper than its pixels
    # Noise of one small tile, moved about: a fresh field for each 4K frame would take longer than rendering.
    tile = rng.normal(size=(256, 256, 1)).astype(np.float32) * camera.noise
    repeats = (camera.height // 256 + 1, camera.width // 256 + 1, 1)
    noise = np.tile(tile, repeats)[: camera.height, : camera.width]
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def _lens(camera: Camera) -> tuple[Exposed, Exposed]:
    matrix, coefficients = camera.matrix, np.array([camera.distortion, 0, 0, 0])
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(np.float64)[:, None]
    straight = cv2.undistortPoints(pixels, matrix, coefficients, P=matrix)
    maps = straight.reshape(camera.height, camera.width, 2).astype(np.float32)
    return maps[..., 0], maps[..., 1]


@dataclass(slots=True)
class _Stage:
    """The set, a renderer for the board alone, and the still picture of everything else."""

    model: mujoco.MjModel
    data: mujoco.MjData
    camera: Camera
    whole: mujoco.Renderer
    part: mujoco.Renderer
    corner: tuple[int, int]
    """Left and top of the part of the picture that moves [px]."""
    still: Exposed

    def expose(self, stamp: float, motion: Motion) -> Exposed:
        """Return one frame, BGR, whose first row's exposure is centred on `stamp` [s]."""
        hand = self._hand(stamp)
        left, top = (0, 0) if hand else self.corner
        renderer = self.whole if hand else self.part
        width, height = renderer.width // self.camera.samples, renderer.height // self.camera.samples
        rows = top + np.arange(height)
        centres = stamp + self.camera.readout * rows / self.camera.height
        half = self.camera.exposure / 2
        begin, end = centres[0] - half, centres[-1] + half
        turned = np.abs(np.diff(motion.at(np.linspace(begin, end, 16)))).sum()
        steps = turned * self.part.width / 2 / self.camera.samples / self.camera.step
        instants = np.linspace(begin, end, 1 + int(np.ceil(steps)))
        weights = _box_weights(instants, centres - half, centres + half)
        exposed = np.zeros((height, width, 3), np.float32)
        for weight, roll in zip(weights, motion.at(instants), strict=True):
            exposed += weight[:, None, None].astype(np.float32) * self.render(renderer, roll, left, top)
        picture = self.still.copy()
        picture[top : top + height, left : left + width] = exposed
        return picture

    def _hand(self, stamp: float) -> bool:
        span = self.camera.hand
        inside = span is not None and span[0] <= stamp < span[1]
        share = (stamp - span[0]) / (span[1] - span[0]) if inside and span else 0.0
        height = 0.05 + 0.22 * share
        self.data.mocap_pos[0] = (self.model.body("deck").pos[0] - 0.5, 0.0, height) if inside else HAND_AWAY
        return inside

    def render(self, renderer: mujoco.Renderer, roll: float, left: int, top: int) -> Exposed:
        """Return the part of the picture that `renderer` covers from this corner on, at a roll [rad]."""
        self.data.qpos[0] = roll
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        renderer.update_scene(self.data, _viewpoint(self.camera, float(self.model.body("deck").pos[2])))
        focal = self.camera.focal * self.camera.width
        fine = self.camera.samples
        for eye in renderer.scene.camera:
            near = eye.frustum_near
            columns = np.array([left, left + renderer.width / fine]) - self.camera.width / 2
            rows = np.array([top + renderer.height / fine, top]) - self.camera.height / 2
            eye.frustum_center = columns.mean() / focal * near
            eye.frustum_width = np.ptp(columns) / 2 / focal * near
            eye.frustum_bottom, eye.frustum_top = -rows / focal * near
            tilt = np.radians(self.camera.roll_deg)
            forward, up = np.array(eye.forward), np.array(eye.up)
            eye.up = np.cos(tilt) * up + np.sin(tilt) * np.cross(forward, up)
        picture = renderer.render()[:, :, ::-1]
        if fine > 1:
            size = (renderer.width // fine, renderer.height // fine)
            picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        return picture.astype(np.float32)


@contextmanager
def _stage(board: Board, mark: Mark, camera: Camera) -> Generator[_Stage]:
    model = mujoco.MjModel.from_xml_string(film_xml(board, mark), film_textures(mark))
    data = mujoco.MjData(model)
    left, top, right, bottom = _reach(board, camera)
    fine = camera.samples
    whole = mujoco.Renderer(model, fine * camera.height, fine * camera.width)
    part = mujoco.Renderer(model, fine * (bottom - top), fine * (right - left))
    try:
        stage = _Stage(model, data, camera, whole, part, (left, top), np.zeros(0, np.float32))
        data.mocap_pos[0] = HAND_AWAY
        stage.still = stage.render(whole, 0.0, 0, 0)
        yield stage
    finally:
        whole.close()
        part.close()


def _reach(board: Board, camera: Camera) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom [px] of what the deck and its mark can cover."""
    size = {name: quantity.value for name, quantity in board.geometry.items()}
    aside = np.sin(np.radians(max(abs(camera.yaw_deg), abs(camera.pitch_deg)))) * size["length"]
    reach = (np.hypot(size["width"] / 2, 0.11) + aside) / camera.distance * camera.focal * camera.width
    middle = np.array([camera.width, camera.height]) / 2
    low, high = np.maximum(middle - reach, 0).astype(int), np.minimum(middle + reach, 2 * middle).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _viewpoint(camera: Camera, axis_height: float) -> mujoco.MjvCamera:
    view = mujoco.MjvCamera()
    view.type = mujoco.mjtCamera.mjCAMERA_FREE
    view.lookat[:] = (-0.4, 0.0, axis_height + 0.02)
    view.distance = camera.distance
    view.azimuth = -camera.yaw_deg
    view.elevation = -camera.pitch_deg
    return view


def _box_weights(instants: Array, begin: Array, end: Array) -> Array:
    """Weights (k, rows) that integrate a function, linear between `instants`, from begin to end."""
    if len(instants) == 1:
        return np.ones((1, len(begin)))
    step = instants[1] - instants[0]

    def ramp(time: Array) -> Array:
        """Integral of each instant's hat function up to `time`, in steps."""
        x = np.clip((time[None, :] - instants[:, None]) / step, -1, 1)
        return np.where(x < 0, (1 + x) ** 2 / 2, 1 - (1 - x) ** 2 / 2)

    weights = ramp(end) - ramp(begin)
    return weights / weights.sum(axis=0)
