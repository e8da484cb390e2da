"""Shake is the camera's own: a deck that was taken for background is found out."""

import numpy as np
import pytest
from backgrounds import light, people, soft
from drawn_films import decay, draw_film, marked, plate, rmse, wall

from sysid.errors import SysidError
from sysid.video_roll import VideoOptions, roll_from_video

TIME = np.arange(72) / 60
ROLL = decay(TIME)


def read(path, **options):
    return roll_from_video(path, VideoOptions(method="marker", readout=0.0, **options))


@pytest.mark.slow
def test_shake_before_a_wall_is_taken_out(tmp_path):
    rng = np.random.default_rng(3)
    path = 4 * np.cumsum(rng.normal(size=(len(TIME), 2)), axis=0) / np.sqrt(len(TIME))
    film = draw_film(tmp_path / "shaken.mp4", marked(plate(), 64), ROLL, move=lambda n: tuple(path[n]))
    roll = read(film)
    assert any(note.startswith("shake: ") for note in roll.notes)
    assert rmse(roll, ROLL) < 0.15
    assert not any(note.startswith("shake: ") for note in read(film, no_shake=True).notes)


def test_a_hand_that_goes_away_leaves_the_wall_as_background(tmp_path):
    """It passes all of the picture's upper half, in which most of the wall is seen."""
    behind, hand = wall(), np.full((60, 60, 3), 90, np.uint8)

    def leaving(number):
        picture = behind.copy()
        left, top = 560 - 8 * number, 90 - number
        picture[max(top, 0) : top + 60, max(left, 0) : left + 60] = hand[: top + 60, max(-left, 0) :]
        return picture

    body, shift = marked(plate(300, 140), 120), 3 * np.sin(9 * TIME)
    film = draw_film(tmp_path / "hand.mp4", body, ROLL, background=leaving, move=lambda n: (shift[n], 0.0))
    roll = read(film)
    assert any(note.startswith("shake: ") for note in roll.notes)
    assert not any("background" in warning for warning in roll.warnings)
    assert rmse(roll, ROLL) < 0.15


def test_what_trembles_is_not_refused_for_its_pace(tmp_path):
    """A marker that trembles by less than a degree at 10 Hz is no board that takes a faster camera."""
    film = draw_film(tmp_path / "trembles.mp4", marked(plate(), 64), decay(TIME, 0.008, 1.0, 63.0))
    assert any("no measurement of a board" in warning for warning in read(film).warnings)


def test_a_camera_that_pans_says_so(tmp_path):
    film = draw_film(tmp_path / "pan.mp4", marked(plate(), 64), ROLL, move=lambda n: (6.0 * n, 0.0))
    with pytest.raises(SysidError, match="the camera pans"):
        roll_from_video(film, VideoOptions(method="features"))


@pytest.mark.slow
@pytest.mark.parametrize("behind", [soft(), light(soft(4)), people(wall())], ids=["soft", "light", "people"])
def test_a_still_camera_does_not_pan_whatever_is_behind_the_board(behind, tmp_path):
    film = draw_film(tmp_path / "behind.mp4", marked(plate(contrast=35.0), 64), ROLL, background=behind)
    for no_shake in (False, True):
        roll = read(film, no_shake=no_shake)
        assert not any(note.startswith("shake: ") for note in roll.notes)
        assert rmse(roll, ROLL) < 0.1
