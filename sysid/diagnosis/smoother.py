"""Kalman smoothing of a linear joint with torque noise, as one banded system.

In the units of `Motion` the joint is ẍ = -k x - d v - u(t) - η. u is a given torque. η is white torque noise of ε times the local
torque. The states of all nodes have a block tridiagonal precision matrix. Its Cholesky factor gives the smoothed motion, the
likelihood, and the Gram matrix of the log and any torques after whitening (Rauch, Tung, Striebel 1965; Grewal and Andrews, Kalman
Filtering, 2015). ε → 0 is output error, a large ε is equation error.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky_banded, expm
from scipy.linalg.lapack import dtbtrs  # pyright: ignore[reportAttributeAccessIssue, reportUnknownVariableType]

from sysid.diagnosis.motion import Motion
from sysid.roll import Array

DIFFUSE = 10.0
"""Prior deviation of the states at the start of a release, in widest swings: any start is as likely."""
DRAWS = 48
"""Draws from which the spread of the rate is taken: to a fifth, and better after smoothing."""
MEMORY = 0.2
"""Correlation time of the torque noise, in periods."""


def transition(stiffness: float, damping: float, step: float) -> tuple[Array, Array, Array]:
    """Return the exact step of ẍ = -k x - d v + u, with u linear in time, in units of `Motion`.

    Returns:
        Factors of the states [1], shape (2, 2), and of u at both ends [1], shape (2,).
    """
    block = np.zeros((4, 4))
    block[0, 1] = block[1, 2] = 1.0
    block[1, 0], block[1, 1], block[2, 3] = -stiffness, -damping, 1.0 / step
    moved: Array = np.asarray(expm(block * step), dtype=np.float64)
    return moved[:2, :2], moved[:2, 2] - moved[:2, 3], moved[:2, 3]


class Smoother:
    """The banded system of one motion, stiffness, damping, and sensor variance."""

    def __init__(self, motion: Motion, stiffness: float, damping: float, local: Array) -> None:
        """Assemble what does not depend on ε.

        Args:
            motion: The log.
            stiffness: k of the linear joint.
            damping: d of the linear joint.
            local: Local torque, shape (r, n): η is a share of it.
        """
        self.motion, self.inside = motion, motion.inside
        flat = self.inside.ravel()
        starts = np.zeros_like(self.inside)
        starts[:, 0] = True
        self.first = starts.ravel()[flat]
        self.size = int(flat.sum())
        self.pairs = np.flatnonzero(~self.first)  # nodes with one before them
        h = motion.step
        self.moved, self.early, self.late = transition(stiffness, damping, h)
        root = np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])
        self.white = np.linalg.inv(np.linalg.cholesky(root))
        density = 2 * np.pi * MEMORY * (stiffness * local.ravel()[flat][self.pairs]) ** 2
        self.size_of_noise = 1.0 / np.sqrt(density)
        self.unit = self.white[None] * self.size_of_noise[:, None, None]  # whitens the torque noise of ε = 1
        lag = motion.lag.ravel()[flat]
        if motion.is_rate:
            self.seen = np.column_stack([-stiffness * lag, 1 - damping * lag])
        else:
            self.seen = np.column_stack([1 - stiffness * lag**2 / 2, lag - damping * lag**2 / 2])
        self.precision = 1.0 / motion.variance.ravel()[flat]
        self.reads = self.precision > 0
        self.reading = motion.reading.ravel()[flat]

    def flat(self, values: Array) -> Array:
        """Return the values [1] at the nodes inside, shape (n, ...)."""
        return values.reshape(-1, *values.shape[2:])[self.inside.ravel()]

    def grid(self, values: Array) -> Array:
        """Return values [1] at the nodes inside on the whole grid, shape (r, n), 0 outside."""
        out = np.zeros(self.inside.shape)
        out[self.inside] = values
        return out

    def impulses(self, torques: Array) -> Array:
        """Return what torques [1], shape (n, m), do in each step to the states after it, shape (p, 2, m)."""
        before, after = torques[self.pairs - 1], torques[self.pairs]
        return self.early[:, None] * before[:, None] + self.late[:, None] * after[:, None]

    def factor(self, share: float) -> tuple[Array, Array, float]:
        """Return the Cholesky factor of the precision, its whitened steps, and the log determinant of the readings' covariance.

        Args:
            share: ε [1].

        Returns:
            Shapes (4, 2 n) as a lower band, and (p, 2, 2).
        """
        size = self.size_of_noise / share
        white = self.unit / share
        back = white @ self.moved
        diagonal = np.zeros((self.size, 2, 2))
        diagonal[self.first] = np.eye(2) / DIFFUSE**2
        diagonal += self.precision[:, None, None] * self.seen[:, :, None] * self.seen[:, None, :]
        diagonal[self.pairs] += white.transpose(0, 2, 1) @ white
        diagonal[self.pairs - 1] += back.transpose(0, 2, 1) @ back
        below = -(white.transpose(0, 2, 1) @ back)  # rows: the node, columns: the one before
        band = np.zeros((4, 2 * self.size))
        even, odd = slice(0, None, 2), slice(1, None, 2)
        band[0, even], band[0, odd], band[1, even] = diagonal[:, 0, 0], diagonal[:, 1, 1], diagonal[:, 1, 0]
        at = 2 * (self.pairs - 1)
        band[2, at], band[3, at] = below[:, 0, 0], below[:, 1, 0]
        band[1, at + 1], band[2, at + 1] = below[:, 0, 1], below[:, 1, 1]
        lower = cholesky_banded(band, lower=True, check_finite=False)
        own = float(np.linalg.slogdet(self.white)[1])
        prior = 2 * float(np.log(size).sum()) + len(size) * own - 2 * int(self.first.sum()) * np.log(DIFFUSE)
        spread = (
            2 * float(np.log(lower[0]).sum()) - 2 * prior - float(np.log(self.precision[self.reads]).sum())
        )
        return lower, white, spread

    def _pulled(self, impulses: Array) -> tuple[Array, Array]:
        """Return impulses whitened for ε = 1, and their part of the right-hand side, shapes (p, 2, m), (n, 2, m)."""
        scaled = self.unit @ impulses
        right = np.zeros((self.size, 2, impulses.shape[2]))
        right[self.pairs] = self.unit.transpose(0, 2, 1) @ scaled
        right[self.pairs - 1] -= (self.unit @ self.moved).transpose(0, 2, 1) @ scaled
        return scaled, right

    def prepare(self, torques: Array, sensed: Array) -> None:
        """Take the columns of a regression [1]: opposing torques, shape (n, m), and what the sensor may add, shape (n, s)."""
        force, right = self._pulled(self.impulses(torques))
        read = np.column_stack([self.reading, sensed])
        seen = (self.precision[:, None] * read)[:, None, :] * self.seen[:, :, None]
        m = torques.shape[1]
        every = np.concatenate([seen[:, :, :1], right, seen[:, :, 1:]], axis=2).reshape(2 * self.size, -1)
        self.right, self.m = np.asfortranarray(every), m
        whole, sensor = force.reshape(-1, m), np.sqrt(self.precision)[:, None] * read
        self.of_force, self.of_sensor = whole.T @ whole, sensor.T @ sensor

    def gram(self, share: float) -> tuple[Array, float]:
        """Return the Gram matrix of the whitened log, torques and sensor terms, and the log determinant of the readings' covariance.

        Args:
            share: ε [1].

        Returns:
            Shape (1 + m + s, 1 + m + s), the reading first.
        """
        lower, _, spread = self.factor(share)
        own = slice(1, 1 + self.m)
        solved = self.right.copy(order="F")
        solved[:, own] /= share**2
        solved, _ = dtbtrs(lower, solved, uplo="L", overwrite_b=1)
        total = -(solved.T @ solved)
        total[own, own] += self.of_force / share**2
        outer = np.r_[0, 1 + self.m : len(total)]
        total[np.ix_(outer, outer)] += self.of_sensor
        return total, spread

    def smooth(
        self, share: float, torque: Array | None = None, sensed: Array | None = None, *, spread: bool = True
    ) -> "Smoothed":
        """Return the smoothed motion under an opposing torque.

        Args:
            share: ε [1].
            torque: Shape (r, n).
            sensed: What the sensor added, shape (n,).
            spread: Whether the variance of the rate is wanted; 0 where not.
        """
        lower, white, determinant = self.factor(share)
        read = self.reading if sensed is None else self.reading - sensed
        right = (self.precision * read)[:, None, None] * self.seen[:, :, None]
        push = self.impulses(-(np.zeros((self.size, 1)) if torque is None else self.flat(torque)[:, None]))
        more = self._pulled(push)[1] / share**2
        half, _ = dtbtrs(lower, np.asfortranarray((right + more).reshape(-1, 1)), uplo="L")
        states, _ = dtbtrs(lower, half, uplo="L", trans="T")
        states = states.reshape(-1, 2)
        # The spread of the states: the mean square of draws from their posterior, smoothed over neighbours.
        rate_variance = np.zeros(self.size)
        if spread:
            draws = np.random.default_rng(0).standard_normal((2 * self.size, DRAWS))
            drawn, _ = dtbtrs(lower, np.asfortranarray(draws), uplo="L", trans="T")
            rate_variance = _smoothed(np.mean(drawn[1::2] ** 2, axis=1))
        missed = read - (self.seen * states).sum(axis=1)
        noise = white @ (states[self.pairs, :, None] - self.moved @ states[self.pairs - 1, :, None] - push)
        misfit = np.where(self.reads, self.precision * missed**2, 0.0)
        misfit[self.pairs] += (noise**2).sum(axis=(1, 2))
        return Smoothed(
            angle=self.grid(states[:, 0]), rate=self.grid(states[:, 1]), rate_variance=self.grid(rate_variance),
            misfit=self.grid(misfit), cost=float(misfit.sum()) + determinant,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Smoothed:
    """A smoothed motion, each shape (r, n)."""

    angle: Array
    rate: Array
    rate_variance: Array
    misfit: Array
    """Terms of χ² of each node: its reading, and the torque noise before it."""
    cost: float
    """-2 log likelihood, constants left out."""


def _smoothed(values: Array) -> Array:
    return np.convolve(values, np.ones(5) / 5, mode="same")
