"""What is made of a decoded picture."""

import cv2
import numpy as np
import pytest
from frames import frame_of

from sysid.video.film.frames import halved, in_colour


@pytest.mark.parametrize("shape", [(360, 640), (359, 641), (270, 480)])
def test_a_small_picture_in_colour_is_that_of_the_whole_one(shape):
    rng = np.random.default_rng(3)
    coarse = rng.uniform(40, 210, (9, 16, 3)).astype(np.float32)
    picture = cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
    frame = frame_of(0, 0.0, picture)
    bright, times = halved(frame.picture, 200)
    small = in_colour(bright, [halved(one, 200)[0] for one in frame.chroma])
    whole, scale = halved(frame.coloured()[0], 200)
    assert times == scale == 4
    assert np.abs(small.astype(int) - whole.astype(int)).max() <= 4
