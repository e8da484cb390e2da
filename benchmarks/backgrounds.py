"""Backgrounds of drawn films: soft walls, curtains, light that changes, people who walk past."""

from collections.abc import Callable

import cv2
import numpy as np
from drawn_films import SIZE, Picture, blotches

RATE = 60.0
"""Frames/s."""


def soft(seed: int = 2) -> Picture:
    """Return a wall out of focus: colours that change over 8 px or more."""
    rng = np.random.default_rng(seed)
    noise = np.dstack([cv2.GaussianBlur(rng.normal(size=(SIZE[1], SIZE[0])), (0, 0), 8.0) for _ in range(3)])
    return np.clip(140 + 14 * noise / noise.std(), 0, 255).astype(np.uint8)


def curtain(number: int) -> Picture:
    """Return soft folds that sway sideways by up to 6 px."""
    x = np.arange(SIZE[0]) + 6 * np.sin(2 * np.pi * 0.7 * number / RATE)
    folds = 140 + 25 * np.sin(x / 14) + 15 * np.sin(x / 33 + 1)
    return np.repeat(np.repeat(folds[None, :, None], SIZE[1], 0), 3, 2).astype(np.uint8)


def light(behind: Picture) -> Callable[[int], Picture]:
    """Return a background under light that falls to 60 % and flickers by 5 %."""

    def at(number: int) -> Picture:
        gain = 1 - 0.4 * min(number / 90, 1.0) + 0.05 * np.sin(2.1 * number)
        return np.clip(behind * gain, 0, 255).astype(np.uint8)

    return at


def people(behind: Picture) -> Callable[[int], Picture]:
    """Return a background in which two people in patterned clothes walk past, one to either side."""
    clothes = [blotches((240, 70), level, 30.0, seed) for level, seed in ((80.0, 7), (190.0, 8))]

    def at(number: int) -> Picture:
        picture = behind.copy()
        for pattern, left in zip(clothes, (-70 + 6 * number, 640 - 5 * number), strict=True):
            low, high = max(left, 0), min(left + 70, SIZE[0])
            if low < high:
                picture[100:340, low:high] = pattern[:, low - left : high - left]
        return picture

    return at


def held(number: int) -> tuple[float, float]:
    """Return the shift of a camera held by hand [px]."""
    return 3 * float(np.sin(6 * number / RATE)), 2 * float(np.sin(4 * number / RATE + 1))
