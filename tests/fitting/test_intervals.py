"""Profiles and bootstraps: one interval where the cost is a parabola, the true shape where it is not."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import called
from made import decays

from sysid.board import load_board
from sysid.errors import SysidError
from sysid.fitting.bootstrap import bootstrap, corrected_percentiles
from sysid.fitting.intervals import agreements
from sysid.fitting.joint import fit_joint
from sysid.fitting.profile import profile, profiles
from sysid.joint import JointLaw
from sysid.least_squares import Normal, minimise
from sysid.quantity import Z95, Quantity
from sysid.workspace import shipped_data

NOISE = np.radians(0.1)
BOARD = replace(
    load_board(shipped_data() / "boards" / "pink.toml"), inertia=Quantity(0.0087, 0.0, "kg*m^2", "exact")
)
LAW = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.402)


def least_squares(residual):
    """Cost and normal equations of a residual of one or more unknowns, by differences."""

    def normal(x):
        r = residual(x)
        steps = 1e-6 * np.eye(len(x))
        j = np.column_stack([(residual(x + s) - residual(x - s)) / 2e-6 for s in steps])
        return Normal(0.5 * float(r @ r), j.T @ r, j.T @ j)

    return normal


def found(normal, start, low=-50.0, high=50.0):
    p = len(start)
    minimum = minimise(normal, np.array(start), np.full(p, low), np.full(p, high), tolerance=1e-12)
    return minimum, np.full(p, low), np.full(p, high)


def releases_of(law, seed, *, angles=(0.19, -0.15, 0.11), stiffer=None, rho=0.0):
    time = np.arange(0.0, 0.6, 0.002)
    if stiffer is None:
        return decays(law, angles, time, NOISE, seed=seed, rho=rho, end="rest")
    laws = [replace(law, stiffness=law.stiffness * share) for share in stiffer]
    return [decays(one, angles, time, NOISE, seed=seed, end="rest")[n] for n, one in enumerate(laws)]


def test_a_parabola_gives_the_jacobians_interval():
    rng = np.random.default_rng(0)
    table, measured = rng.standard_normal((40, 3)), rng.standard_normal(40)
    normal = least_squares(lambda x: table @ x - measured)
    minimum, low, high = found(normal, [0.0, 0.0, 0.0])
    for index in range(3):
        plain = np.sqrt(np.linalg.inv(table.T @ table)[index, index])
        for widened in (1.0, 2.5):  # by correlated residuals
            shape = profile(normal, minimum, low, high, index, widened * plain)
            ends = np.subtract(shape.interval, minimum.point[index])
            assert ends == pytest.approx([-Z95 * widened * plain, Z95 * widened * plain], rel=1e-3)
            assert shape.deeper == 0


def test_a_bent_cost_gives_an_asymmetric_interval():
    """ln x measured as ln 2 ± 0.4: the interval is 2 e^(± 1.96 · 0.4) whatever the Jacobian says."""
    normal = least_squares(lambda x: np.array([(np.log(np.maximum(x[0], 1e-9)) - np.log(2.0)) / 0.4]))
    minimum, low, high = found(normal, [1.5], low=1e-6)
    shape = profile(normal, minimum, low, high, 0, 0.8)
    assert shape.interval == pytest.approx((2 * np.exp(-Z95 * 0.4), 2 * np.exp(Z95 * 0.4)), rel=0.01)


def test_bounds_and_open_ends_and_side_valleys_are_said():
    near_zero = least_squares(lambda x: np.array([x[0] - 0.5]))
    minimum, low, high = found(near_zero, [0.3], low=0.0)
    shape = profile(near_zero, minimum, low, high, 0, 1.0)
    assert shape.at_bound == (True, False)
    assert shape.interval == pytest.approx((0.0, 0.5 + Z95), abs=0.01)

    saturates = least_squares(lambda x: np.array([np.arctan(x[0])]))
    minimum, low, high = found(saturates, [0.1], low=-1e6, high=1e6)
    assert np.isinf(profile(saturates, minimum, low, high, 0, 1.0).interval).all()

    valleys = least_squares(lambda x: np.array([2 * (x[0] ** 2 - 1), 0.5 * (x[0] - 1)]))
    minimum, low, high = found(valleys, [-1.2], low=-3.0, high=3.0)
    assert minimum.point[0] < 0
    shape = profile(valleys, minimum, low, high, 0, 0.6)
    assert shape.deeper > 0.1
    assert shape.best > 0.5


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_profiles_of_a_linear_joint_equal_the_jacobians(rho):
    fit = fit_joint(releases_of(LAW, 1, rho=rho), BOARD)
    for shape in profiles(fit, BOARD):
        expected = np.subtract(fit.quantities[shape.name].ci95, fit.quantities[shape.name].value)
        assert np.subtract(shape.interval, fit.quantities[shape.name].value) == pytest.approx(
            expected, rel=0.12
        )


def test_the_inertias_uncertainty_is_in_the_profile():
    unsure = replace(BOARD, inertia=Quantity(0.0087, 0.0004, "kg*m^2", "guessed"))
    fit = fit_joint(releases_of(LAW, 1), unsure)
    shape = next(iter(profiles(fit, unsure)))
    assert np.diff(shape.interval)[0] == pytest.approx(np.diff(fit.quantities["stiffness"].ci95)[0], rel=0.05)
    assert np.diff(shape.interval)[0] > 2 * Z95 * 0.0004 / 0.0087 * 14.6


@pytest.mark.slow
def test_drawing_blocks_foretells_the_scatter():
    """Of fits to other logs of the same board, white and correlated noise."""
    for rho in (0.0, 0.8):
        scatter = np.std(
            [list(q.value for q in fit_joint(releases_of(LAW, s, rho=rho), BOARD).quantities.values()) for s in range(40)],
            axis=0,
        )  # fmt: skip
        drawn = bootstrap(fit_joint(releases_of(LAW, 100, rho=rho), BOARD), BOARD, 100)
        assert drawn.drawn == "blocks"
        assert (drawn.block == 1) == (rho == 0)
        assert np.std(drawn.draws, axis=0) == pytest.approx(scatter, rel=0.4)


def test_whole_releases_show_what_differs_between_them():
    """A stiffness that scatters by 3 % from release to release: no look at residuals shows how unsure its mean is."""
    rng = np.random.default_rng(5)
    releases = releases_of(LAW, 6, angles=[0.19, -0.15] * 8, stiffer=1 + 0.05 * rng.standard_normal(16))
    fit = fit_joint(releases, BOARD)
    drawn = bootstrap(fit, BOARD, 100)
    assert drawn.drawn == "releases"
    deviation = float(np.std(drawn.draws[:, 0]))
    assert deviation == pytest.approx(0.05 * 14.684 / 4, rel=0.4)
    verdict = agreements(fit.quantities, (), drawn)[0]
    assert verdict.trust == "bootstrap"
    assert "releases differ from one another" in verdict.text


def test_percentiles_do_not_depend_on_how_a_parameter_is_written():
    rng = np.random.default_rng(7)
    logs = 0.3 * rng.standard_normal(20_000) + 0.1  # biased draws about 0
    low, high = corrected_percentiles(np.exp(logs), 1.0)
    assert (low, high) == pytest.approx(tuple(np.exp(corrected_percentiles(logs, 0.0))))
    assert np.log([low, high]) == pytest.approx([-0.1 - Z95 * 0.3, -0.1 + Z95 * 0.3], abs=0.03)


def test_too_few_draws_are_refused():
    fit = fit_joint(releases_of(LAW, 1), BOARD)
    with pytest.raises(SysidError, match="too few for the ends"):
        bootstrap(fit, BOARD, 20)


def test_the_command_prints_draws_and_writes_them(tmp_path, capsys):
    log = shipped_data() / "decays" / "pink_hidden.csv"
    options = ("--effect", "coulomb", "--profile", "--bootstrap", 100)
    place = ("--workspace", tmp_path, "--json", tmp_path / "fit.json")
    assert called("fit", log, "--board", "pink", *options, *place) == 0
    out = json.loads((tmp_path / "fit.json").read_text())
    assert set(out["profile"]) == set(out["bootstrap"]["ci95"]) == set(out["parameters"])
    low, high = out["profile"]["coulomb.torque"]["ci95"]
    best = out["parameters"]["coulomb.torque"]["value"]
    assert low < best < high
    assert (high - best) > 1.2 * (best - low)  # where the deck stops is decided there
    assert {item["trust"] for item in out["intervals"]} <= {"Jacobian", "profile", "bootstrap"}
    shown = capsys.readouterr().out
    assert "trust the profile's interval" in shown
    assert (tmp_path / "reports/pink/intervals.png").stat().st_size > 10_000
