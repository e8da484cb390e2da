"""The best tracker of a clip is the one that is used, and level is taken from what shows it."""

import cv2
import numpy as np
import pytest
from drawn_films import FINE, SIZE, decay, dotted, draw_film, marked, plate

from sysid.errors import SysidError
from sysid.video_roll import VideoOptions, roll_from_video

TIME = np.arange(72) / 60
ROLL = decay(TIME) + np.radians(2.0)
"""The board rests askew, which only something level shows."""
PLAIN = np.full((SIZE[1], SIZE[0], 3), 160, np.uint8)
PINK, GREEN, PALE = (110, 20, 240), (60, 200, 40), (242, 191, 115)


def error_of(roll):
    """RMSE with the horizontal, and without a common offset [deg]."""
    error = np.degrees(roll.roll - ROLL[: len(roll.roll)])
    return np.sqrt(np.mean(error**2)), np.std(error)


def read(path, **options):
    return roll_from_video(path, VideoOptions(readout=0.0, **options))


@pytest.fixture(scope="module")
def wide(tmp_path_factory):
    """A small marker on a wide deck with texture, in front of a plain wall: nothing else has texture."""
    body = marked(plate(520, 90, contrast=35.0), 42)
    return draw_film(tmp_path_factory.mktemp("select") / "wide.mp4", body, ROLL, background=PLAIN)


@pytest.mark.slow
def test_texture_gives_the_angle_and_the_marker_what_is_level(wide):
    best = read(wide)
    assert any("patches of texture" in note and "marker 7" in note for note in best.notes)
    assert any("marker's edges are level" in note for note in best.notes)
    assert error_of(best)[1] < 0.01
    assert error_of(best)[0] < 0.15


def test_everything_that_turns_with_a_marker_tells_the_angle(wide):
    """The corners of this marker alone tell it to 0.09°."""
    marker = read(wide, method="marker")
    assert any(
        "marker 7; the angle is that of everything that turns with it" in note for note in marker.notes
    )
    assert not any("shake" in note for note in marker.notes)  # the deck is not the background
    assert error_of(marker)[1] < 0.015
    assert error_of(marker)[0] < 0.15


@pytest.mark.slow
def test_a_speck_does_not_beat_texture(tmp_path):
    body = dotted(plate(300, 80, contrast=35.0), [(60, 10, 4, PINK)])
    film = draw_film(tmp_path / "speck.mp4", body, ROLL)
    roll = read(film)
    assert any("patches of texture" in note for note in roll.notes)
    assert error_of(roll)[1] < 0.03
    assert error_of(read(film, method="dots"))[1] > 2 * error_of(roll)[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("colours", "method"),
    [((PINK, GREEN), "auto"), ((PINK, PINK), "dots"), ((PINK, PALE), "dots")],
)
def test_two_stickers_may_differ_in_colour(colours, method, tmp_path):
    dots = [(-100, -5, 11, colours[0]), (100, -5, 11, colours[1])]
    roll = read(draw_film(tmp_path / "pair.mp4", dotted(plate(300, 60), dots), ROLL), method=method)
    assert any("line between the dots is level" in note for note in roll.notes)
    # Two points do not show the camera's direction well, and with it what is level.
    assert error_of(roll)[0] < 0.3
    assert error_of(roll)[1] < 0.25


@pytest.mark.slow
def test_leaves_of_one_colour_are_no_stickers(tmp_path):
    """They are larger than the stickers, alike, and move as well, each on its own."""
    sway = 12 * np.sin(np.outer(2 * np.pi * TIME, [1.3, 2.1]))

    def behind(number):
        picture = PLAIN.copy()
        for x, off in ((90, sway[number, 0]), (540, sway[number, 1])):
            cv2.circle(picture, (round(x + off), 60), 14, GREEN, -1)
        return picture

    stickers = dotted(plate(300, 60), [(-100, -5, 11, PINK), (100, -5, 11, PALE)])
    roll = read(draw_film(tmp_path / "leaves.mp4", stickers, ROLL, background=behind), method="dots")
    assert error_of(roll)[0] < 0.3


@pytest.mark.slow
def test_a_marker_on_the_wall_is_not_the_board(tmp_path):
    behind = PLAIN.copy()
    behind[20:84, 30:94] = marked(plate(64, 64), 64)[1::3, 1::3]
    stickers = dotted(plate(300, 60), [(-100, -5, 11, PINK), (100, -5, 11, PINK)])
    roll = read(draw_film(tmp_path / "wall.mp4", stickers, ROLL, background=behind))
    assert any("two coloured dots" in note and "marker 7 does not turn" in note for note in roll.notes)
    assert error_of(roll)[0] < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "dots"])
def test_prints_askew_do_not_say_what_is_level(method, tmp_path):
    """Two spots of colour, one above the other's side, 50° off level: no stickers that were put on level."""
    spots = [(-25, -32, 9, PINK), (25, 28, 9, PINK)]
    film = draw_film(tmp_path / "prints.mp4", dotted(plate(300, 90, contrast=35.0), spots), ROLL)
    roll = read(film, method=method)
    assert any("zero: where the deck is at the end of the film" in note for note in roll.notes)
    assert abs(np.median(roll.roll)) < np.radians(2)
    assert error_of(roll)[1] < 0.1


@pytest.mark.slow
def test_two_bodies_that_swing_are_asked_about(tmp_path):
    """Two boards with prints, one beside the other; the region of one is enough."""
    other = plate(180, 60, contrast=40.0, seed=9)
    turns = 0.25 * np.cos(2 * np.pi * 2.3 * TIME)

    def behind(number):
        picture, middle = PLAIN.copy(), (np.array(other.shape[1::-1]) - 1) / 2
        turn = cv2.getRotationMatrix2D(tuple(middle), -np.degrees(turns[number]), 1 / FINE)
        turn[:, 2] += (150, 80) - middle
        shown = cv2.warpAffine(other, turn, SIZE, flags=cv2.INTER_AREA)
        cover = cv2.warpAffine(np.full(other.shape[:2], 255, np.uint8), turn, SIZE)
        picture[cover > 128] = shown[cover > 128]
        return picture

    film = draw_film(tmp_path / "two.mp4", plate(180, 60, contrast=40.0), ROLL, background=behind)
    with pytest.raises(SysidError, match=r"two bodies swing, .* --roi \d+ \d+ \d+ \d+ or --roi"):
        read(film)
    assert error_of(read(film, roi=(225, 100, 190, 180)))[1] < 0.1


@pytest.mark.parametrize(("swing", "unknown"), [(0.6, False), (0.04, True)])
def test_a_short_arc_without_a_pivot_leaves_the_scale_open(swing, unknown, tmp_path):
    dot = dotted(plate(30, 400), [(0, -170, 11, PINK)])
    film = draw_film(tmp_path / "arc.mp4", dot, decay(TIME, swing, 0.5, 12.0), background=PLAIN)
    warnings = read(film, method="dots").warnings
    assert any("scale" in one and "--pivot" in one for one in warnings) == unknown
