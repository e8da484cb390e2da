"""Places of edges come near what the noise of a picture allows."""

import cv2
import numpy as np
import pytest
from frames import frame_of
from scipy.special import ndtr

from sysid.video.film.frames import Frame
from sysid.video.trackers._edge_profile import PIECES, find_steps


@pytest.mark.parametrize("taken", [59.5, 59.8, 60.3])
def test_an_edge_is_found_about_as_well_as_white_noise_allows(taken: float):
    """Where a step of contrast c, smoothed by s, lies, n rows of noise σ tell to σ √(2 √π s / n) / c at best; wherever it was taken to be."""
    rng = np.random.default_rng(2)
    contrast, noise, rows, blur = 60.0, 6.0, 320, 0.8
    step = np.where(np.arange(120) < 60, 150.0, 150.0 - contrast)
    clean = cv2.GaussianBlur(np.tile(step, (rows + 40, 1)), (0, 0), blur)
    ends = np.array([[[taken, 20.0], [taken, 20.0 + rows]]])
    found = []
    for _ in range(20):
        grey = np.clip(clean + rng.normal(0, noise, clean.shape), 0, 255).astype(np.uint8)
        frame = frame_of(0, 0.0, np.repeat(grey[..., None], 3, axis=2))
        found.append(find_steps(frame, ends[:, ::-1], 4.0, 1.0)[0, :, 0])
    bound = noise * np.sqrt(2 * np.sqrt(np.pi) * blur / (rows / PIECES)) / contrast
    assert np.std(found) < 1.4 * bound
    assert np.mean(found) == pytest.approx(59.5, abs=0.015)


def test_an_edge_that_is_nearly_level_is_not_turned_by_the_grid_of_pixels():
    off = []
    for place in 19.5 + np.linspace(0, 1, 10, endpoint=False):
        for slope in (0.002, 0.004, 0.006):
            ends = np.array([[[5.0, place - 55 * slope], [115.0, place + 55 * slope]]])
            (found,) = find_steps(_black_below(place, slope), ends, 2.5, 1.0)
            off.append(np.polyfit(found[:, 0], found[:, 1], 1)[0] - slope)
    assert np.degrees(np.sqrt(np.mean(np.square(off)))) < 0.02


def _black_below(place: float, slope: float) -> Frame:
    """Return what a lens with a blur of 0.8 px makes of an edge that lies `place` px down."""
    fine, size = 16, (40, 120)
    y, x = np.mgrid[: fine * size[0], : size[1]]
    light = 0.85 - 0.83 * ndtr(((y + 0.5) / fine - 0.5 - place - slope * (x - 60.0)) / 0.8)
    grey = 255 * light.reshape(size[0], fine, size[1]).mean(axis=1)
    return frame_of(0, 0.0, np.clip(np.round(grey), 0, 255).astype(np.uint8))
