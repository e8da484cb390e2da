"""What is followed lies inside the region that the user gives; a pivot is for one dot."""

import cv2
import numpy as np
import pytest
from drawn_films import write_pictures

from sysid.errors import SysidError
from sysid.video_roll import VideoOptions, roll_from_video

SIZE = (480, 240)
LEFT, RIGHT = (0, 0, 240, 240), (240, 0, 240, 240)
TIME = np.arange(60) / 60
ROLL = 0.3 * np.exp(-3 * TIME) * np.cos(25 * TIME)


def write_film(path, walk=0.0):
    """Write a marker that turns on the left and walks to the right [px a frame], two dots that turn the other way on the right."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    card = np.pad(cv2.aruco.generateImageMarker(dictionary, 7, 60), 15, constant_values=255)
    grain = np.random.default_rng(0).uniform(-450, 680, (240, 480, 1)).repeat(3, axis=2)
    wall = np.clip(cv2.GaussianBlur(grain, (0, 0), 3), 0, 255)
    pictures = []
    for step, roll in enumerate(ROLL):
        picture = wall.astype(np.uint8)
        turn = cv2.getRotationMatrix2D((44.5, 44.5), -np.degrees(roll), 1.0)
        turn[:, 2] += (120 - 44.5 + walk * step, 120 - 44.5)
        place = {"borderMode": cv2.BORDER_TRANSPARENT, "flags": cv2.INTER_AREA}
        cv2.warpAffine(cv2.cvtColor(card, cv2.COLOR_GRAY2BGR), turn, SIZE, dst=picture, **place)
        for side in (-70, 70):
            x, y = 360 + side * np.cos(roll), 120 - side * np.sin(roll)
            cv2.circle(picture, (round(8 * x), round(8 * y)), 80, (90, 20, 240), -1, cv2.LINE_AA, 3)
        pictures.append(picture)
    return write_pictures(path, pictures)


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    return write_film(tmp_path_factory.mktemp("region") / "two.avi")


def followed(film, **options):
    roll = roll_from_video(film, VideoOptions(readout=0.0, **options))
    return " ".join(roll.notes), float(np.corrcoef(roll.roll, ROLL[: len(roll.roll)])[0, 1])


@pytest.mark.slow
def test_auto_follows_what_is_in_the_region(film):
    for roi in (None, LEFT):
        note, likeness = followed(film, roi=roi)
        assert "marker 7" in note
        assert likeness > 0.99
    note, likeness = followed(film, roi=RIGHT)
    assert "two coloured dots" in note
    assert likeness < -0.99


@pytest.mark.parametrize(
    ("method", "roi", "words"),
    [
        ("marker", RIGHT, "no ArUco or AprilTag marker is seen in --roi 240 0 240 240"),
        ("marker", (110, 100, 40, 40), "no ArUco or AprilTag marker is seen in --roi 110 100 40 40"),
        ("dots", LEFT, "no coloured dot that moves is seen in --roi 0 0 240 240"),
        ("dots", (400, 0, 80, 30), "what moves is all outside --roi 400 0 80 30"),
        ("auto", (0, 0, 60, 60), "what moves is all outside --roi 0 0 60 60"),
        ("marker", (400, 0, 100, 100), "inside the picture of 480x240"),
    ],
)
def test_nothing_in_the_region_is_refused_in_one_line(film, method, roi, words):
    with pytest.raises(SysidError, match=words) as error:
        roll_from_video(film, VideoOptions(method=method, roi=roi))
    assert "\n" not in str(error.value)


def test_a_marker_that_leaves_the_region_is_not_followed_out_of_it(tmp_path):
    path = write_film(tmp_path / "walk.avi", walk=3.0)
    assert "marker 7" in followed(path, roi=(0, 0, 480, 240))[0]
    with pytest.raises(SysidError, match=r"marker 7 is seen in only \d+ of 60 frames"):
        roll_from_video(path, VideoOptions(method="marker", roi=LEFT))


def test_a_pivot_is_for_one_dot(film):
    for method in ("marker", "features", "edge"):
        with pytest.raises(SysidError, match=f"--method {method} --pivot 360 120: known are auto, dots"):
            roll_from_video(film, VideoOptions(method=method, pivot=(360.0, 120.0)))
    # One dot of the pair, about the middle between both; the marker beside it is not what a pivot is for.
    note, likeness = followed(film, pivot=(360.0, 120.0), roi=RIGHT)
    assert "one coloured dot" in note
    assert "given pivot" in note
    assert likeness < -0.99
