"""Prediction of what was left out."""

import numpy as np

from sysid.fitting.cross_validation import _information, _predicted
from sysid.least_squares import Minimum, Normal


class Folded:
    """A release that says x² = 1, and nothing of x at 0."""

    def bounds(self):
        return np.array([-5.0]), np.array([5.0])

    def unnoticed(self, cost):
        return 1e-7

    def residuals(self, point):
        return [point**2 - 1.0]

    def normal(self, point):
        residual, slope = point**2 - 1.0, np.diag(2 * point)
        return Normal(0.5 * float(residual @ residual), slope @ residual, slope @ slope)


def predicted(expected, known, point):
    here, (together,) = Folded().normal(point), Folded().residuals(point)
    return _predicted(Folded(), expected, known, point, here, together)


def test_what_the_others_leave_open_is_sought_where_all_releases_have_it():
    nothing = np.zeros((1, 1))
    missed = predicted(np.zeros(1), nothing, np.array([1.2]))
    assert abs(missed[0]) < 1e-3
    stuck = predicted(np.zeros(1), nothing, np.zeros(1))
    assert abs(stuck[0] + 1) < 1e-3


def test_what_the_others_know_stays():
    known = np.array([[1e6]])
    missed = predicted(np.array([0.5]), known, np.array([1.0]))
    assert abs(missed[0] + 0.75) < 1e-3


def test_a_rough_cost_says_no_more_than_it_rises():
    """Steep at its least, it is but 2 higher a unit beside it, where a bowl as steep would be 50; in other directions it counts as it is."""
    curvature = np.diag([100.0, 1.0])
    least = Minimum(np.zeros(2), Normal(1.0, np.zeros(2), curvature), "converged", 1, np.zeros(2, dtype=bool))
    for cost, share in ((3.0, 0.04), (51.0, 1.0), (80.0, 1.0)):
        known = _information(least, np.array([1.0, 0.0]), Normal(cost, np.zeros(2), curvature), 2)
        np.testing.assert_allclose(known, np.diag([share * 100.0, 1.0]))
    # No higher where the fit began: of that direction next to nothing is known, and not less.
    for cost in (1.0, 0.5):
        known = _information(least, np.array([1.0, 0.0]), Normal(cost, np.zeros(2), curvature), 2)
        assert 0 < known[0, 0] < 1e-6
        assert known[1, 1] == 1.0
