"""The noise floor: what a release shows at rest counts for noise, what is left of its swing does not."""

import numpy as np
import pytest
from made import release

from sysid.noise.floor import noise_floor

NOISE = 1e-4
TIME = np.arange(0.0, 4.0, 5e-3)


def at_rest(roll, time=TIME):
    return release(time, roll, NOISE, end="rest")


def noise(seed, memory=0.0):
    """Noise that forgets within so many samples, shape (n,)."""
    rng, kept = np.random.default_rng(seed), np.exp(-1 / memory) if memory else 0.0
    values = [rng.standard_normal()]
    for white in rng.standard_normal(len(TIME) - 1):
        values.append(kept * values[-1] + np.sqrt(1 - kept**2) * white)
    return NOISE * np.array(values)


def swing(time, zeta=0.02):
    return 0.15 * np.exp(-zeta * 40 * time) * np.cos(40 * time)


def test_a_swing_that_lasts_is_no_noise_where_samples_are_lost():
    """A lost sample shifts a swing that is counted in samples: noise was twice what it is."""
    kept = np.random.default_rng(1).random(len(TIME)) > 0.01
    floor = noise_floor([at_rest((0.1 * swing(TIME, 0.01) + noise(2))[kept], TIME[kept])])
    assert floor.std == pytest.approx(NOISE, rel=0.15)


@pytest.mark.parametrize(("pace", "end"), [(20, 2.8), (25, 2.8), (40, 2.7)])
def test_what_stops_in_the_midst_of_the_stretch_at_rest_is_motion(pace, end):
    """Dry friction ends a last swing, which is no sine: a sensor's noise does not fade."""
    stops = 0.15 * np.maximum(0, 1 - TIME / end) * np.cos(pace * TIME)
    assert noise_floor([at_rest(stops + noise(3))]).std == pytest.approx(NOISE, rel=0.15)


def test_noise_that_lasts_is_read_at_rest():
    floor = noise_floor([at_rest(swing(TIME, 0.1) + noise(4, memory=4.0))])
    assert "at rest" in floor.how
    assert floor.std == pytest.approx(NOISE, rel=0.25)
