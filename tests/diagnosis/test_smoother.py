"""The banded smoother against dense Gaussian algebra on a small random case."""

from dataclasses import replace

import numpy as np
import pytest
from made_motion import motion_of_angles
from scipy.linalg import expm

from sysid.diagnosis.smoother import DIFFUSE, MEMORY, Smoother

K, D, SHARE, NODES = 1.1, 0.2, 0.1, 12


class Dense:
    """The same joint as one Gaussian: mean response to torques, covariance of states and readings."""

    def __init__(self, motion, local):
        h, rows = motion.step, []
        root = np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])
        offset, total = 0, int(motion.length.sum())
        self.covariance = np.zeros((2 * total, 2 * total))
        self.moves = []
        for r, n in enumerate(motion.length):
            block = np.zeros((2 * n, 2 * n))
            block[:2, :2] = np.eye(2) * DIFFUSE**2
            for j in range(1, n):
                a = np.array([[0.0, 1.0], [-K, -D]])
                f = expm(a * h)
                block[2 * j : 2 * j + 2, : 2 * j] = f @ block[2 * j - 2 : 2 * j, : 2 * j]
                block[: 2 * j, 2 * j : 2 * j + 2] = block[2 * j : 2 * j + 2, : 2 * j].T
                noise = 2 * np.pi * MEMORY * (SHARE * K * local[r, j]) ** 2 * root
                block[2 * j : 2 * j + 2, 2 * j : 2 * j + 2] = (
                    f @ block[2 * j - 2 : 2 * j, 2 * j - 2 : 2 * j] @ f.T + noise
                )
                self.moves.append((offset + j, a, f))
            self.covariance[2 * offset : 2 * (offset + n), 2 * offset : 2 * (offset + n)] = block
            rows += [(r, j) for j in range(n)]
            offset += n
        self.rows, self.h = rows, h
        self.reads = [i for i, (r, j) in enumerate(rows) if np.isfinite(motion.variance[r, j])]
        self.seen = np.zeros((len(self.reads), 2 * total))
        for k, i in enumerate(self.reads):
            lag = motion.lag[rows[i]]
            self.seen[k, 2 * i : 2 * i + 2] = 1 - K * lag**2 / 2, lag - D * lag**2 / 2
        noise = np.diag([motion.variance[rows[i]] for i in self.reads])
        self.spread = self.seen @ self.covariance @ self.seen.T + noise
        self.reading = np.array([motion.reading[rows[i]] for i in self.reads])

    def response(self, torque):
        """Return the states that an opposing torque, shape (r, n) and linear between nodes, makes from rest."""
        states = np.zeros((len(self.rows), 2))
        at, weights = np.polynomial.legendre.leggauss(12)
        for i, a, f in self.moves:
            u0, u1 = (torque[self.rows[k]] for k in (i - 1, i))
            push = np.zeros(2)
            for s, w in zip((at + 1) / 2, weights / 2, strict=True):
                push += w * self.h * expm(a * self.h * (1 - s)) @ [0.0, -(u0 + s * (u1 - u0))]
            states[i] = f @ states[i - 1] + push
        return states.ravel()


@pytest.fixture(scope="module")
def case():
    rng = np.random.default_rng(3)
    motion = motion_of_angles(rng.normal(size=(2, 9)), NODES, noise=0.05)
    variance = motion.variance * rng.uniform(0.5, 2.0, motion.variance.shape)
    variance[0, 4] = np.inf
    motion = replace(
        motion, variance=variance, lag=rng.uniform(-0.1, 0.1, variance.shape), length=np.array([9, 6]),
        reading=np.where(np.isfinite(variance), motion.reading, 0.0),
    )  # fmt: skip
    local = rng.uniform(0.3, 1.0, variance.shape)
    return motion, local, rng.normal(size=(2, 9)), Dense(motion, local), Smoother(motion, K, D, local)


def test_log_determinant_is_that_of_the_readings_covariance(case):
    *_, dense, smoother = case
    assert smoother.factor(SHARE)[2] == pytest.approx(np.linalg.slogdet(dense.spread)[1], abs=1e-7)


def test_states_are_the_gaussian_posterior_under_a_torque(case):
    motion, _, torque, dense, smoother = case
    mean = dense.response(torque)
    gain = dense.covariance @ dense.seen.T @ np.linalg.inv(dense.spread)
    states = (mean + gain @ (dense.reading - dense.seen @ mean)).reshape(-1, 2)
    found = smoother.smooth(SHARE, torque)
    for grid, column in ((found.angle, 0), (found.rate, 1)):
        np.testing.assert_allclose(grid[motion.inside], states[:, column], atol=1e-7)
    left = dense.reading - dense.seen @ mean
    starts = states[[0, 9]]
    quadratic = left @ np.linalg.solve(dense.spread, left) - np.sum(starts**2) / DIFFUSE**2
    assert found.cost == pytest.approx(quadratic + np.linalg.slogdet(dense.spread)[1], abs=1e-6)


def test_gram_matrix_is_that_of_whitened_reading_torque_and_sensor(case):
    _, _, torque, dense, smoother = case
    sensed = np.random.default_rng(4).normal(size=(smoother.size, 1))
    smoother.prepare(smoother.flat(torque)[:, None], sensed)
    gram, _ = smoother.gram(SHARE)
    table = np.column_stack([dense.reading, dense.seen @ dense.response(torque), sensed[dense.reads]])
    np.testing.assert_allclose(gram, table.T @ np.linalg.solve(dense.spread, table), rtol=1e-6, atol=1e-7)


def test_spread_of_the_rate_is_near_the_posterior_one(case):
    motion, *_, dense, smoother = case
    gain = dense.covariance @ dense.seen.T @ np.linalg.inv(dense.spread)
    exact = np.diag(dense.covariance - gain @ dense.seen @ dense.covariance)[1::2]
    found = smoother.smooth(SHARE).rate_variance[motion.inside]
    assert np.mean(found) == pytest.approx(np.mean(exact), rel=0.35)
