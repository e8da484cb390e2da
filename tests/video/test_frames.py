"""What is made of a decoded picture."""

import av
import cv2
import numpy as np
import pytest
from film_container import film_writer
from frames import frame_of

from sysid.video.film.frames import halved, in_colour, open_clip


def test_a_film_opened_without_a_guess_of_its_rate_shows_the_same_frames_at_the_same_times(tmp_path):
    rng = np.random.default_rng(5)
    stamps = np.cumsum(rng.uniform(0.01, 0.03, 40))
    path = tmp_path / "uneven.mp4"
    with film_writer(path, (64, 48), stamps, 0.5, 60.0) as write:
        for level in np.linspace(20, 230, len(stamps)):
            write(np.full((48, 64, 3), level, np.uint8))
    with av.open(str(path)) as film:
        usual = [(frame.time, np.asarray(frame.to_ndarray()[:48, :64])) for frame in film.decode(video=0)]
    seen = list(open_clip(path).frames())
    assert len(seen) == len(usual) == len(stamps)
    assert [frame.time for frame in seen] == pytest.approx([time for time, _ in usual])
    assert all(
        np.array_equal(frame.picture, picture) for frame, (_, picture) in zip(seen, usual, strict=True)
    )


@pytest.mark.parametrize("shape", [(360, 640), (359, 641), (270, 480)])
def test_a_small_picture_in_colour_is_that_of_the_whole_one(shape):
    rng = np.random.default_rng(3)
    coarse = rng.uniform(40, 210, (9, 16, 3)).astype(np.float32)
    picture = cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
    frame = frame_of(0, 0.0, picture)
    bright, times = halved(frame.picture, 200)
    small = in_colour(bright, [halved(one, 200)[0] for one in frame.chroma])
    whole, scale = halved(frame.colour, 200)
    assert times == scale == 4
    assert np.abs(small.astype(int) - whole.astype(int)).max() <= 4
