"""Pictures of a film on the time line of its roll."""

import numpy as np

from reports.rerun.film_frames import read_film
from sysid.logs import LogOptions


def test_a_film_comes_with_its_pictures_in_step_with_its_roll(marker_film):
    roll, frames = read_film(marker_film.path, LogOptions())
    assert len(frames.pictures) == len(frames.time)
    # Frame for frame the same time as the sample made of it.
    np.testing.assert_allclose(
        frames.time[np.searchsorted(frames.time, roll.time - 1e-4)], roll.time, atol=1e-3
    )
    assert all(picture[:2] == b"\xff\xd8" for picture in frames.pictures)
    later = frames.aligned(0.4)
    np.testing.assert_allclose(later.time, frames.time - 0.4)
