"""Places of edges come near what the noise of a picture allows."""

import cv2
import numpy as np
import pytest
from frames import frame_of
from scipy.special import ndtr

from sysid.roll import Array
from sysid.video.film.frames import Frame
from sysid.video.trackers._edge_profile import PIECES, Aliasing, find_steps


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
        found.append(find_steps(frame, ends[:, ::-1], 4.0, 8.0, 1.0)[0][0, 0, :, 0])
    bound = noise * np.sqrt(2 * np.sqrt(np.pi) * blur / (rows / PIECES)) / contrast
    assert np.std(found) < 1.4 * bound
    assert np.mean(found) == pytest.approx(59.5, abs=0.015)


def test_an_edge_that_is_nearly_level_is_not_turned_by_the_grid_of_pixels():
    off = []
    for place in 19.5 + np.linspace(0, 1, 10, endpoint=False):
        for slope in (0.002, 0.004, 0.006):
            ends = np.array([[[5.0, place - 55 * slope], [115.0, place + 55 * slope]]])
            (found,) = find_steps(_black_below(place, slope, 0.8, 1.0, 0.0), ends, 2.5, 8.0, 1.0)[0][0]
            off.append(np.polyfit(found[:, 0], found[:, 1], 1)[0] - slope)
    assert np.degrees(np.sqrt(np.mean(np.square(off)))) < 0.02


def test_a_step_is_doubted_for_what_changes_beside_it_and_for_how_little_it_steps():
    down = np.arange(40)[:, None]
    clear = np.where(down < 20, 160.0, 60.0)
    faint = np.where(down < 20, 80.0, 60.0)
    beside = clear + 40.0 * (down >= 23)  # a wheel behind a deck's lower edge
    picture = np.repeat(np.hstack([clear, faint, beside]), 100, axis=1)
    frame = frame_of(0, 0.0, cv2.GaussianBlur(picture, (0, 0), 0.8).astype(np.uint8))
    ends = np.array([[[100.0 * part + 10, 19.5], [100.0 * part + 90, 19.5]] for part in range(3)])
    points, doubt = find_steps(frame, ends, 2.5, 8.0, 1.0)
    sure, little, disturbed = np.median(doubt[0], axis=1)
    assert sure == pytest.approx(0.035, abs=0.005)
    assert little == pytest.approx(5 * sure, rel=0.3)
    assert disturbed > 2.5 * sure
    assert np.isfinite(points).all()


def test_both_sides_of_a_stripe_are_found_by_how_brightness_steps():
    shade = np.where(np.abs(np.arange(60) - 29.5) < 5, 60.0, 160.0)  # from 24.5 to 34.5
    picture = cv2.GaussianBlur(np.tile(shade[:, None], (1, 200)), (0, 0), 0.8).astype(np.uint8)
    along = np.array([[[20.0, 29.5], [180.0, 29.5]]])
    rises, falls = find_steps(frame_of(0, 0.0, picture), along, 8.0, 8.0, 1.0, (1, -1))[0][:, 0, :, 1]
    assert rises == pytest.approx(24.5, abs=0.05)  # the normal of the way to the right is up
    assert falls == pytest.approx(34.5, abs=0.05)


def test_an_edge_that_the_camera_sharpened_is_found_beside_its_halo():
    """Sharpening makes brightness overshoot beside an edge: that is a step the other way, a pixel or two beside it."""
    soft = np.tile(
        np.repeat([20.0, 110.0, 200.0], [30, 1, 29])[:, None], (1, 200)
    )  # it lies in the middle of row 30
    sharp = np.clip(soft + 0.5 * (soft - cv2.GaussianBlur(soft, (0, 0), 1.2)), 0, 255).astype(np.uint8)
    along = np.array([[[20.0, 30.0], [180.0, 30.0]]])
    rises, falls = find_steps(frame_of(0, 0.0, sharp), along, 2.5, 8.0, 1.0, (1, -1))[0][:, 0, :, 1]
    assert falls == pytest.approx(30.0, abs=0.1)
    assert np.isnan(rises).all()


def _black_below(place: float, slope: float, lens: float, tone: float, sharpening: float) -> Frame:
    """What a camera makes of an edge that lies `place` px down: a lens' blur [px], pixels' mean light, tone curve and sharpening."""
    fine, size = 16, (40, 120)
    y, x = np.mgrid[: fine * size[0], : size[1]]
    light = 0.85 - 0.83 * ndtr(((y + 0.5) / fine - 0.5 - place - slope * (x - 60.0)) / lens)
    grey = 255 * light.reshape(size[0], fine, size[1]).mean(axis=1) ** (1 / tone)
    grey += sharpening * (grey - cv2.GaussianBlur(grey, (0, 0), 1.2))
    return frame_of(0, 0.0, np.clip(np.round(grey), 0, 255).astype(np.uint8))


@pytest.mark.parametrize("camera", [(0.35, 1.0, 0.6), (0.35, 2.2, 0.6), (0.2, 2.2, 0.0)])
def test_edges_at_a_slant_tell_what_the_grid_does_to_level_ones(camera):
    """A step that is sampled too coarsely is found beside where it is, by a wave of its phase; whatever made it so coarse."""
    aliasing = Aliasing()

    def found(place: float, slope: float) -> tuple[Array, Array]:
        ends = np.array([[[30.0, place - 30 * slope], [90.0, place + 30 * slope]]])
        (pieces,), _ = find_steps(_black_below(place, slope, *camera), ends, 4.0, 8.0, 2.8)
        return pieces, ends

    for number, slope in enumerate(np.linspace(-0.06, 0.06, 16)):
        aliasing.learn(*found(18.0 + 0.37 * number, slope))
    places = 19.0 + np.linspace(0, 1, 20, endpoint=False)
    level = [found(place, 0.0) for place in places]
    before = np.mean([pieces[0, :, 1] for pieces, _ in level], axis=1) - places
    after = np.mean([aliasing.taken_from(*one)[0, :, 1] for one in level], axis=1) - places
    assert np.std(before) > 0.015
    assert np.std(after) < np.std(before) / 3


def test_a_picture_that_stays_tells_of_aliasing_once():
    """A crease in the paper would be taken for it if a board at rest showed it a thousand times."""
    once, often = Aliasing(), Aliasing()
    ends = np.array([[[30.0, 19.0], [90.0, 20.0]]])
    (pieces,), _ = find_steps(_black_below(19.5, 1 / 60, 0.35, 2.2, 0.6), ends, 4.0, 8.0, 2.8)
    once.learn(pieces, ends)
    for _ in range(1000):
        often.learn(pieces, ends)
    assert often.taken_from(pieces, ends) == pytest.approx(once.taken_from(pieces, ends), abs=1e-12)
