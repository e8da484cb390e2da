"""What is made of a decoded picture."""

import av
import numpy as np
import pytest
from film_container import film_writer

from sysid.video.film.frames import open_clip


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
