"""Releases and records as tests make them: what matters is given, the rest is as of a faultless log."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from sysid.board import Board, BoardEffect
from sysid.effects import effect
from sysid.joint import JointLaw, simulate
from sysid.quantity import Quantity
from sysid.roll import Array, Release


def release(
    time: Array, roll: Array, noise: float = 0.0, *, rng: np.random.Generator | None = None, **given: Any
) -> Release:
    """Return a decay of an angle.

    Args:
        time: Time [s], shape (n,).
        roll: Angle [rad], shape (n,).
        noise: Standard deviation that the log states [rad].
        rng: Adds noise of that size to the angle.
        given: Further fields of the release.
    """
    noisy = roll if rng is None else roll + noise * rng.standard_normal(len(time))
    usual: dict[str, Any] = {
        "log": "made",
        "number": 1,
        "origin": "angle",
        "rest": 0.0,
        "hold": 1.0,
        "end": "log",
    }
    return Release(**(usual | {"time": time, "roll": noisy, "std": np.full(len(time), noise)} | given))


def decays(
    law: JointLaw,
    angles: Iterable[float],
    time: Array,
    noise: float,
    *,
    seed: int = 0,
    rho: float = 0.0,
    **given: Any,
) -> list[Release]:
    """Return simulated decays from some angles [rad], three seconds apart on the log's clock.

    Args:
        time: Times since each release [s], shape (n,).
        noise: Standard deviation of the noise [rad], of which neighbouring samples have the correlation `rho`.
        given: Further fields of each release.
    """
    rng, made = np.random.default_rng(seed), list[Release]()
    for number, angle in enumerate(angles, start=1):
        roll = simulate(law, time, angle).roll
        white = rng.standard_normal(len(time) + 100 * (rho > 0))
        sensed = lfilter([np.sqrt(1 - rho**2)], [1.0, -rho], white)[-len(time) :]
        made.append(
            release(
                time + 3.0 * number, roll + noise * sensed, noise, number=number, rest=law.rest_angle, **given
            )
        )
    return made


def with_effect(board: Board, name: str, *values: float) -> Board:
    """Return a record whose only effect has these values, or those of its example."""
    part = effect(name)
    pairs = zip(part.parameters, values or part.example, strict=True)
    return replace(board, effects=(BoardEffect(name, {p.name: Quantity(v, 0.0, p.unit) for p, v in pairs}),))
