"""The search of all fits: a known minimum, in a box, and numbers that rounding has spoilt."""

import numpy as np
import pytest

from sysid.least_squares import Normal, minimise


def line(slope, level):
    """Return what evaluates the squares of a line's misfit to y = 3 x + 1 at x = 0, 1, 2, of (slope, level)."""
    design = np.array([[0.0, 1.0], [1.0, 1.0], [2.0, 1.0]])

    def evaluate(point):
        residual = design @ point - np.array([level, slope + level, 2 * slope + level])
        return Normal(0.5 * residual @ residual, design.T @ residual, design.T @ design)

    return evaluate


def test_a_line_is_found():
    found = minimise(line(3.0, 1.0), np.zeros(2), np.full(2, -10.0), np.full(2, 10.0))
    assert found.point == pytest.approx([3.0, 1.0], abs=1e-6)


def test_a_bound_is_kept_and_the_rest_is_the_best_within_it():
    """With the slope at most 2, the level is the mean of 1, 4, 7 less 2 x: (1 + 2 + 3) / 3."""
    found = minimise(line(3.0, 1.0), np.zeros(2), np.full(2, -10.0), np.array([2.0, 10.0]))
    assert found.point == pytest.approx([2.0, 2.0], abs=1e-6)


def test_a_search_ends_where_what_it_can_still_gain_is_not_noticed():
    """From the start, the cost of 33 can fall to 0: by all of it, which only one of the two calls notices."""
    box = np.full(2, -10.0), np.full(2, 10.0)
    ends = [minimise(line(3.0, 1.0), np.zeros(2), *box, tolerance=lambda cost, t=t: t) for t in (1e-5, 1.0)]
    assert [end.normal.cost for end in ends] == [pytest.approx(0.0, abs=1e-6), pytest.approx(33.0)]
