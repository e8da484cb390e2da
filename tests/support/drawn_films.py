"""Films of a plate that turns about a point, drawn rather than rendered: a second each, exact to a thousandth of a pixel.

No lens, no depth: for what a file, a codec or a choice does to the angle. `film.py` has the faults of a camera.
"""

from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from film_container import film_writer

from sysid.roll import Array, Roll

Picture = npt.NDArray[np.uint8]
SIZE = (640, 360)
FINE = 3
"""Pixels of a drawing in one of the film, along each side."""
PIVOT = (320.0, 190.0)


def decay(time: Array, amplitude: float = 0.3, rate: float = 3.0, frequency: float = 25.0) -> Array:
    """Return a damped swing from a hold of 0.2 s [rad], shape (n,)."""
    since = np.maximum(time - 0.2, 0.0)
    return amplitude * np.exp(-rate * since) * np.cos(frequency * since)


def rmse(roll: Roll, truth: Array, fps: float = 60.0) -> float:
    """Return the error of a roll without its common offset, by the truth in each frame [rad], shape (n,); in degrees."""
    error = roll.roll - np.interp(roll.time, np.arange(len(truth)) / fps, truth)
    return float(np.degrees(np.sqrt(np.mean((error - np.median(error[-10:])) ** 2))))


def write_pictures(path: Path, pictures: Iterable[Picture], fps: float = 60.0) -> Path:
    """Write pictures as a film, Motion JPEG."""
    first, *others = pictures
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), fps, first.shape[1::-1])
    for picture in (first, *others):
        writer.write(picture)
    writer.release()
    return path


def wall(contrast: float = 20.0, seed: int = 0) -> Picture:
    """Return a background with blotches."""
    return blotches((SIZE[1], SIZE[0]), 150.0, contrast, seed)


def blotches(shape: tuple[int, int], level: float, contrast: float, seed: int) -> Picture:
    """Return a grey picture with detail of 5 to 40 px."""
    rng = np.random.default_rng(seed)
    picture = sum(cv2.GaussianBlur(rng.normal(size=shape), (0, 0), size) * size for size in (2.0, 5.0, 15.0))
    grey = level + contrast * picture / picture.std()
    return np.clip(grey, 0, 255).astype(np.uint8)[..., None].repeat(3, axis=2)


def plate(width: int = 260, height: int = 70, *, contrast: float = 0.0, seed: int = 1) -> Picture:
    """Return a plate in fine pixels: plain, or with texture."""
    shape = (FINE * height, FINE * width)
    fine = cv2.resize(
        blotches((height, width), 90.0, contrast, seed), shape[::-1], interpolation=cv2.INTER_CUBIC
    )
    return np.asarray(fine, np.uint8)


def marked(picture: Picture, side: int, number: int = 7) -> Picture:
    """Return the plate with a marker of `side` px, margin included, in its middle."""
    cells = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), number, 6)
    card = np.pad(cells, 1, constant_values=255)
    card = cv2.resize(card, (FINE * side, FINE * side), interpolation=cv2.INTER_NEAREST)[..., None]
    top, left = (np.array(picture.shape[:2]) - FINE * side) // 2
    picture = picture.copy()
    picture[top : top + FINE * side, left : left + FINE * side] = card
    return picture


def dotted(picture: Picture, dots: list[tuple[float, float, float, tuple[int, int, int]]]) -> Picture:
    """Return the plate with discs: each x and y from the middle [px], radius [px] and colour."""
    picture = picture.copy()
    middle = np.array(picture.shape[1::-1]) / 2
    for x, y, radius, colour in dots:
        place = tuple(np.round(middle + FINE * np.array([x, y])).astype(int).tolist())
        cv2.circle(picture, place, round(FINE * radius), colour, -1, cv2.LINE_AA)
    return picture


def draw_film(
    path: Path,
    body: Picture,
    roll: Array,
    *,
    fps: float = 60.0,
    background: Picture | Callable[[int], Picture] | None = None,
    bits: float = 0.6,
    noise: float = 1.5,
    move: Callable[[int], tuple[float, float]] | None = None,
) -> Path:
    """Write a film in which `body`, in fine pixels, turns about its middle, clockwise for a positive roll [rad], shape (n,).

    The background stands still or is seen in each frame; `move` shifts the whole picture in a frame [px].
    """
    behind = wall() if background is None else background
    look = behind if callable(behind) else lambda number: behind
    rng = np.random.default_rng(5)
    with film_writer(path, SIZE, np.arange(len(roll)) / fps, bits, fps) as write:
        for number, angle in enumerate(roll):
            shift = (0.0, 0.0) if move is None else move(number)
            write(_frame(look(number), body, float(angle), shift, noise, rng))
    return path


def _frame(
    behind: Picture,
    body: Picture,
    angle: float,
    shift: tuple[float, float],
    noise: float,
    rng: np.random.Generator,
) -> Picture:
    size = (FINE * SIZE[0], FINE * SIZE[1])
    slide = np.array([[1, 0, shift[0]], [0, 1, shift[1]]])
    picture = cv2.warpAffine(behind, slide, SIZE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    middle = (np.array(body.shape[1::-1]) - 1) / 2
    turn = cv2.getRotationMatrix2D((float(middle[0]), float(middle[1])), -np.degrees(angle), 1.0)
    # Fine pixel FINE·p + (FINE - 1) / 2 is the middle of pixel p.
    turn[:, 2] += FINE * (np.array(PIVOT) + shift) + (FINE - 1) / 2 - middle
    cover = cv2.warpAffine(np.full(body.shape[:2], 255, np.uint8), turn, size)
    fine = cv2.warpAffine(body, turn, size, flags=cv2.INTER_LINEAR)
    share = cv2.resize(cover, SIZE, interpolation=cv2.INTER_AREA)[..., None] / 255.0
    drawn = cv2.resize(fine, SIZE, interpolation=cv2.INTER_AREA)
    mixed = picture * (1 - share) + drawn * share + noise * rng.normal(size=(SIZE[1], SIZE[0], 1))
    return np.clip(cv2.GaussianBlur(mixed, (0, 0), 0.6), 0, 255).astype(np.uint8)
