"""Logs with a known truth for the decay tests, made without any of the tool's own model code.

A linear decay comes from the matrix exponential's closed form, any other law from scipy's DOP853.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from sysid.roll import Roll

DEGREE = np.pi / 180


def linear_decay(time, omega, zeta, start=1.0, rate=0.0):
    """Roll and rate of φ̈ + 2ζω φ̇ + ω² φ = 0 from the complex pair of poles (or two real ones)."""
    root = np.sqrt(complex((zeta + 1e-6 * (zeta == 1)) ** 2 - 1))  # no division by zero at ζ = 1
    one, two = -omega * (zeta + root), -omega * (zeta - root)
    b = (rate - one * start) / (two - one)
    a = start - b
    position = a * np.exp(one * time) + b * np.exp(two * time)
    speed = a * one * np.exp(one * time) + b * two * np.exp(two * time)
    return position.real, speed.real


def integrated_decay(time, law: Callable, start=1.0, rate=0.0):
    """Roll and rate of φ̈ = law(φ, φ̇), to 1e-10."""
    result = solve_ivp(
        lambda _, y: (y[1], law(y[0], y[1])),
        (0, time[-1]),
        (start, rate),
        "DOP853",
        time,
        rtol=1e-9,
        atol=1e-11,
    )
    return result.y[0], result.y[1]


def lift(time, duration):
    """From 0 to 1 as a hand moves: least jerk (Flash and Hogan, 1985)."""
    s = np.clip(time / duration, 0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


@dataclass
class Recipe:
    omega: float = 41.083
    zeta: float = 0.56265
    sampling: float = 200.0
    noise: float = 0.1 * DEGREE
    amplitudes: tuple = (0.2,)
    rest: float = 0.0
    before: float = 1.0
    lift: float = 0.6
    hold: float = 0.7
    free: float = 1.2
    tremor: float = 0.0
    quantum: float = 0.0
    drift: float = 0.0
    catch_after: float | None = None
    hand_at_end: bool = False
    law: Callable | None = None
    seed: int = 0
    truth: list = field(default_factory=list)
    holds: list = field(default_factory=list)


def make_roll(recipe: Recipe, origin="angle") -> Roll:
    """A whole log: rest, then for each amplitude lift, hold, let go, swing (or be caught)."""
    rng = np.random.default_rng(recipe.seed)
    total = recipe.before + len(recipe.amplitudes) * (recipe.lift + recipe.hold + recipe.free) + 1.0
    time = np.arange(0, total, 1 / recipe.sampling)
    roll, rate = np.zeros_like(time), np.zeros_like(time)
    now = recipe.before
    for number, amplitude in enumerate(recipe.amplitudes, start=1):
        rise = recipe.lift * rng.uniform(0.8, 1.2)
        hold = recipe.hold * rng.uniform(0.8, 1.2)
        release = now + rise + hold
        hand = (time >= now) & (time < release)
        wobble = recipe.tremor * amplitude * np.sin(2 * np.pi * 5 * (time - now) + rng.uniform(0, 6))
        roll[hand] = (amplitude * lift(time - now, rise) + wobble * lift(time - now, rise))[hand]
        now = release + recipe.free
        free = (time >= release) & ((time < now) | (number == len(recipe.amplitudes)))
        since = time[free] - release
        if recipe.law is None:
            position, speed = linear_decay(since, recipe.omega, recipe.zeta, amplitude)
        else:
            position, speed = integrated_decay(since, recipe.law, amplitude)
        if recipe.catch_after is not None:
            caught = since > recipe.catch_after
            first = int(np.argmax(caught))
            position[caught] = position[first] + 0.3 * amplitude * lift(
                since[caught] - recipe.catch_after, 0.3
            )
            away = since > recipe.catch_after + 0.5
            position[away] *= 1 - lift(since[away] - recipe.catch_after - 0.5, 0.4)
        roll[free], rate[free] = position, speed
        recipe.truth.append(release)
        recipe.holds.append(hold)
    if recipe.hand_at_end:
        late = time > now
        roll[late] += 0.15 * lift(time[late] - now, 0.5)
    roll = roll + recipe.rest + recipe.drift * time + rng.normal(0, 1, len(time)) * recipe.noise
    if recipe.quantum:
        roll = np.round(roll / recipe.quantum) * recipe.quantum
    std = np.hypot(recipe.noise, recipe.quantum / np.sqrt(12))
    return Roll(log="made.csv", time=time, roll=roll, std=np.full(len(time), std), origin=origin)


def write_log(path: Path, roll: Roll) -> Path:
    """Write a roll as a CSV file, and return its path."""
    table = np.column_stack([roll.time, roll.roll])
    np.savetxt(path, table, "%.6f", ",", header="time_s,roll_rad", comments="")
    return path
