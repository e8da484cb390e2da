"""The edges of a bare body: lines that turn about one point give the turn; nothing else does."""

import cv2
import numpy as np
import pytest
from drawn_films import SIZE, decay, draw_film, plate, wall
from film_container import film_writer

from sysid.errors import SysidError
from sysid.video.trackers._edge_profile import PIECES
from sysid.video.trackers.edge import fit_edges
from sysid.video_roll import VideoOptions, roll_from_video

TIME = np.arange(90) / 60
ROLL = decay(TIME, 0.35, 4.0)
EDGE = np.repeat([0, 1], PIECES)


def edges(roll, far=0.0):
    """Points of two edges 20 px apart; the upper one turns about a point further up [px], as a deck's far end does."""
    body = np.tile(np.linspace(-90, 90, PIECES), 2) + 1j * np.where(EDGE == 0, -10, 10)
    noise = 0.1 * np.random.default_rng(0).normal(size=(len(roll), len(body)))
    return (body + 1j * noise) * np.exp(1j * roll)[:, None] - 1j * far * (EDGE == 0)


def error_of(angle, roll=ROLL):
    error = np.degrees(angle - roll)
    return np.abs(error - np.median(error[-20:]))


@pytest.mark.parametrize("far", [0.0, 30.0])
def test_edges_tell_turn_and_level_though_far_and_near_end_turn_about_two_points(far):
    fit = fit_edges(edges(ROLL, far))
    assert np.std(error_of(fit.angle)) < 0.05
    assert abs(np.degrees(np.median(fit.angle - ROLL))) < 0.05
    assert np.mean(error_of(fit.angle) < 2 * np.degrees(np.sqrt(fit.variance))) > 0.85


def test_points_that_something_else_has_lent_to_an_edge_are_not_believed():
    """The outer half of the upper edge lies on the outline of a long side while the deck is nearly level."""
    level = np.abs(ROLL) < 0.05
    outline = level[:, None] & (np.arange(2 * PIECES) < PIECES // 2)
    z = edges(ROLL) - 4j * outline
    fit = fit_edges(z)
    assert error_of(fit.angle).max() < 0.2
    assert fit.weight[level][:, : PIECES // 2].mean() < 0.1 * fit.weight[level][:, PIECES:].mean()


@pytest.mark.slow
def test_a_bare_bar_is_read_in_front_of_a_wall(tmp_path):
    film = draw_film(tmp_path / "bar.mp4", plate(320, 40), ROLL, background=wall())
    roll = roll_from_video(film, VideoOptions(method="edge", readout=0.0, camera_angle=(0.0, 0.0)))
    truth = np.interp(roll.time, TIME, ROLL)
    assert error_of(roll.roll, truth).max() < 0.2
    assert abs(np.degrees(np.median(roll.roll - truth))) < 0.1


def test_a_thin_string_in_full_hd_is_read_or_refused_in_one_line(tmp_path):
    """A pendulum's string of two pixels; the pivot is above the picture."""
    size, path = (1920, 1080), tmp_path / "string.mp4"
    with film_writer(path, size, np.arange(30) / 60, 0.1, 60.0) as write:
        for roll in 0.2 * np.cos(6 * np.arange(30) / 60):
            picture = np.full((size[1], size[0], 3), 150, np.uint8)
            end = 960 + 1300 * np.sin(roll), -300 + 1300 * np.cos(roll)
            cv2.line(picture, (960, -300), (round(end[0]), round(end[1])), (40, 40, 40), 2, cv2.LINE_AA)
            write(picture)
    with pytest.raises(SysidError) as error:
        roll_from_video(path, VideoOptions(method="edge"))
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_a_line_that_a_passer_by_hides_is_no_deck(tmp_path):
    """It is not in all pictures, as a line that stands still is, but it does not turn."""
    line = np.full((SIZE[1], SIZE[0], 3), 120, np.uint8)
    line[: SIZE[1] // 2] = 200

    def behind(number):
        seen = line.copy()
        if 12 <= number < 20:
            seen[SIZE[1] // 4 : 3 * SIZE[1] // 4] = 60
        return seen

    film = draw_film(tmp_path / "line.mp4", plate(2, 2), np.zeros(48), background=behind)
    with pytest.raises(SysidError, match=r"does not turn|no straight edge|nothing moves"):
        roll_from_video(film, VideoOptions(method="edge"))
