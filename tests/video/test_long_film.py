"""A film of 48 s with six releases: decoded once, mostly past what memory holds, and as true at its end as at its beginning."""

import numpy as np
import pytest
from drawn_films import draw_film, marked, plate

from sysid.releases import find_releases
from sysid.video_roll import VideoOptions, roll_from_video

RATE, EVERY, RELEASES = 30.0, 8.0, 6
TIME = np.arange(round(RATE * EVERY * RELEASES)) / RATE


def roll_at(time):
    """Each 8 s the board is tilted, held, and let go: 2 Hz, from one side and the other."""
    number, since = np.floor(time / EVERY), time % EVERY - 1.0
    tilt = np.where(number % 2 == 0, 0.3, -0.25)
    lifted = 0.5 - 0.5 * np.cos(np.pi * np.clip((since + 1.0) / 0.6, 0, 1))
    swing = np.exp(-since) * np.cos(4 * np.pi * since)
    return tilt * np.where(since < 0, lifted, swing)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["marker", "features"])
def test_a_long_film_does_not_drift(tmp_path, method):
    """The tripod sinks by 3 px meanwhile, which the background shows."""
    truth, body = roll_at(TIME), plate(380, 80, contrast=30.0)
    film = draw_film(
        tmp_path / "long.mp4", marked(body, 60) if method == "marker" else body, truth, fps=RATE,
        move=lambda number: (0.0, 3.0 * number / len(TIME)),
    )  # fmt: skip
    roll = roll_from_video(film, VideoOptions(method=method, readout=0.0))
    assert len(roll.time) == len(TIME)
    error = roll.roll - truth
    error -= np.median(error)  # level: a deck at rest
    assert np.degrees(np.sqrt(np.mean(error**2))) < 0.05
    thirds = [np.median(part) for part in np.array_split(error, 3)]
    assert np.degrees(np.ptp(thirds)) < 0.01
    assert np.mean(np.abs(error) < 1.96 * roll.std) >= 0.93
    assert len(find_releases(roll)) == RELEASES
