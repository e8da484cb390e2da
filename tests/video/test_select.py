"""The best tracker of a clip is the one that is used, and level is taken from what shows it."""

import re
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from drawn_films import FINE, PIVOT, SIZE, decay, dotted, draw_film, marked, plate

from sysid.errors import SysidError
from sysid.video import select
from sysid.video.pose.angle import AngleTrack
from sysid.video.pose.camera_state import CameraState
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
    """A small marker on a wide deck with texture."""
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
    assert error_of(marker)[1] < 0.015
    assert error_of(marker)[0] < 0.15


@pytest.mark.slow
def test_an_edge_is_looked_for_where_all_else_is_vague(wide, monkeypatch):
    assert not any("edge ±" in note for note in read(wide).notes)
    monkeypatch.setattr(select, "VAGUE", 0.0)
    assert any("the deck's edge ±" in note for note in read(wide).notes)


def test_a_frame_that_only_the_body_shows_has_a_deviation_as_well(monkeypatch):
    """A blurred marker contradicts itself where the deck around it is made out: what both share of doubt stays."""
    camera = CameraState(np.zeros(4), np.zeros((4, 4)))
    angle, std = np.array([0.2, np.nan, 0.0]), np.array([0.004, np.nan, 0.003])
    points = AngleTrack(angle, std, camera, 0.1, 1, np.ones(4), own=std / 2)
    body = AngleTrack(
        np.array([0.2, 0.1, 0.0]), np.full(3, 0.001), camera, 0.1, 0, np.ones(4), np.full(3, 0.001)
    )
    monkeypatch.setattr(select, "fit_angle", lambda *_: body)
    marker = SimpleNamespace(found=points, level=angle, target=SimpleNamespace(shows_turn=True))
    whole = select._solve_whole(marker, None, None, camera)
    np.testing.assert_allclose(whole.angle, body.angle)
    assert whole.std[1] >= max(whole.std[0], whole.std[2]) > 0.003


@pytest.mark.parametrize(("doubt", "further"), [(0.003, 1.0), (0.06, 1.016)])
def test_a_body_turns_as_far_as_the_stickers_on_it(monkeypatch, doubt, further):
    """Made upright by the wrong one of two slants, a deck whose upper side is seen seemed to turn 1.6 % further than its stickers.

    Stickers that doubt their own scale by more contradict nothing.
    """
    camera = CameraState(np.zeros(4), np.zeros((4, 4)))
    std = np.full(len(TIME), 0.002)
    noisy = ROLL + std * np.random.default_rng(0).normal(size=len(TIME))
    noisy[30] += 0.2  # something in front of a sticker
    stated = np.hypot(std, doubt * np.abs(ROLL))
    points = AngleTrack(noisy, stated, camera, 0.1, 0, np.ones(2), std)
    body = AngleTrack(1.016 * ROLL, std / 5, camera, 0.1, 0, np.ones(4), std / 5)
    monkeypatch.setattr(select, "fit_angle", lambda *_: body)
    stickers = SimpleNamespace(found=points, level=noisy, target=SimpleNamespace(shows_turn=True))
    whole = select._solve_whole(stickers, None, None, camera)
    assert np.polyfit(ROLL, whole.angle, 1)[0] == pytest.approx(further, abs=0.004)
    assert np.std(whole.angle - further * ROLL) < 0.0008


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
def test_stickers_far_from_the_edges_of_a_plain_deck_are_seen_to_move(tmp_path):
    dots = [(-150, 10, 7, PINK), (150, 10, 7, PINK)]
    roll = read(draw_film(tmp_path / "far.mp4", dotted(plate(420, 200), dots), ROLL))
    assert any("two coloured dots" in note for note in roll.notes)
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
def test_a_single_sticker_aside_shows_no_level(tmp_path):
    """Its arm rests 22° off the horizontal: zero is where the deck rests, not where the arm would lie flat."""
    film = draw_film(tmp_path / "one.mp4", dotted(plate(300, 90), [(100, -40, 9, PINK)]), ROLL)
    roll = read(film, method="dots")
    assert any("one coloured dot" in note for note in roll.notes)
    assert abs(np.median(roll.roll)) < np.radians(4)


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


def test_blobs_of_a_print_do_not_say_what_is_level(tmp_path):
    """Two spots that fade into the print about them, 8° off level: nobody put them there, however well they are followed."""
    body = plate(300, 90, contrast=35.0)
    rows, columns = np.indices(body.shape[:2]) / FINE
    for x, y in ((60, 32), (240, 58)):
        share = np.exp(-0.5 * ((columns - x) ** 2 + (rows - y) ** 2) / 11**2)[..., None]
        body = np.round((1 - share) * body + share * np.array(PINK)).astype(np.uint8)
    roll = read(draw_film(tmp_path / "print.mp4", body, ROLL))
    assert any("patches of colour" in note for note in roll.notes)
    assert any("zero: where the deck is at the end of the film" in note for note in roll.notes)
    assert abs(np.median(roll.roll[-7:])) < np.radians(0.5)


@pytest.mark.slow
def test_a_pair_put_on_askew_is_doubted(tmp_path):
    """Nothing but the warning tells stickers 8° off level from a board that rests there."""
    dots = [(-100, -16, 11, PINK), (100, 12, 11, PINK)]
    roll = read(draw_film(tmp_path / "askew.mp4", dotted(plate(300, 60), dots), ROLL), method="dots")
    assert any("line between the dots is level" in note for note in roll.notes)
    assert any(re.search(r"(9|10)\.\d° off zero", warning) for warning in roll.warnings)


@pytest.mark.slow
def test_a_better_one_that_moves_otherwise_is_not_the_board(tmp_path):
    """A marker on the deck, and behind it a large picture that somebody carries past."""
    behind = np.full((SIZE[1], SIZE[0], 3), 150, np.uint8)
    poster = plate(200, 90, contrast=45.0, seed=4)[::3, ::3]

    def passing(number):
        picture = behind.copy()
        left = 20 + 5 * number
        picture[4:94, left : left + 200] = poster
        return picture

    film = draw_film(tmp_path / "passing.mp4", marked(plate(200, 100), 70), ROLL, background=passing)
    roll = read(film)
    assert error_of(roll)[0] < 0.2
    assert PIVOT[1] > 140  # the poster passes above the deck


@pytest.mark.parametrize("hidden", [range(18, 22), range(12, 20)])
def test_a_line_that_a_passer_by_hides_is_no_deck(tmp_path, hidden):
    """It is not in all pictures, as what stands still is, but it does not turn."""
    line = np.full((SIZE[1], SIZE[0], 3), 120, np.uint8)
    line[: SIZE[1] // 2] = 200

    def behind(number):
        seen = line.copy()
        if number in hidden:
            seen[SIZE[1] // 4 : 3 * SIZE[1] // 4] = 60
        return seen

    film = draw_film(tmp_path / "line.mp4", plate(2, 2), np.zeros(48), background=behind)
    with pytest.raises(SysidError, match="does not turn"):
        read(film, method="edge")
