"""Trackers are found by being there: a file in the folder is all that a new one takes."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn_films import write_pictures

from sysid.errors import SysidError
from sysid.video import trackers
from sysid.video_roll import VideoOptions, roll_from_video

LAMPS = '''
"""A red and a green lamp on the deck, each the middle of its colour."""

import numpy as np

from sysid.video.pose.angle import fit_angle
from sysid.video.trackers._base import Target, Tracker, level_angle


class LampFollower:
    points, box = 2, (20, 20, 300, 220)

    def update(self, frame):
        blue, green, red = np.moveaxis(frame.colour.astype(float), 2, 0)
        places = []
        for colour in (red - green, green - red):
            weight = np.clip(colour - 60, 0, None)
            rows, columns = np.mgrid[: weight.shape[0], : weight.shape[1]]
            places.append([(weight * columns).sum() / weight.sum(), (weight * rows).sum() / weight.sum()])
        return np.array(places)


TRACKER = Tracker(
    rank=-1,
    find=lambda reel: Target(
        follower=LampFollower(), what="the lamps", why="two lamps", solve=fit_angle,
        zero=lambda track: level_angle(track, complex(track.shape[1] - track.shape[0]), 2),
        zero_note="roll zero is where the lamps are level",
    ),
    not_found="no lamps are seen{where}",
)
'''


@pytest.fixture
def lamps(tmp_path, monkeypatch):
    """A folder with a tracker of its own, beside those of the package."""
    (tmp_path / "lamps.py").write_text(LAMPS)
    monkeypatch.setattr(trackers, "__path__", [*trackers.__path__, str(tmp_path)])
    return tmp_path


def test_a_tracker_is_one_file(lamps):
    assert trackers.names() == ("dots", "edge", "features", "lamps", "marker")
    time = np.arange(60) / 60
    truth = 0.3 * np.exp(-2 * time) * np.cos(20 * time)
    pictures = []
    for roll in truth:
        picture = np.full((240, 320, 3), 90, np.uint8)
        for side, colour in ((-1, (30, 30, 230)), (1, (30, 230, 30))):
            x, y = 160 + side * 80 * np.cos(roll), 120 + side * 80 * np.sin(roll)
            cv2.circle(picture, (round(8 * x), round(8 * y)), 80, colour, -1, cv2.LINE_AA, 3)
        pictures.append(picture)
    path = write_pictures(lamps / "lamps.avi", pictures)
    roll = roll_from_video(path, VideoOptions(method="lamps", readout=0.0))
    assert any(note.startswith("follows: two lamps") for note in roll.notes)
    np.testing.assert_allclose(roll.roll, truth, atol=0.01)
    assert any("lamps" in note for note in roll_from_video(path, VideoOptions(readout=0.0)).notes)


def test_an_unknown_tracker_is_told_the_known_ones():
    film = Path("clip.mp4")
    with pytest.raises(SysidError, match=r"--method lamps: known are auto, marker, dots, features, edge"):
        from sysid.video.film.frames import Clip
        from sysid.video.film.reel import Reel
        from sysid.video.select import follow_board

        follow_board(Reel(Clip(film, 320, 240, 0, 0), None, VideoOptions(method="lamps")))
