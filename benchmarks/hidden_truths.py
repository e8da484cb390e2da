"""Joints with a hidden effect: what is hidden in each log, and the logs.

Truths of the catalogue are made by `sysid.synth` (event-driven DOP853, hand and sensor included), those outside
the catalogue by a DOP853 integration here. Neither shares code with the fit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.board import Board, load_board
from sysid.logs import read_roll
from sysid.quantity import Quantity
from sysid.releases import find_releases
from sysid.roll import Release

ROOT = Path(__file__).parents[1]
LIGHT = 0.04
"""Damping of the lightly damped board [N*m*s/rad]."""
NOISES_DEG = (0.04, 0.1, 0.2)
RATES = (200.0, 500.0, 1000.0)
Torque = Callable[[float, float, float, float], float]
"""Torque [N*m] of (time [s], tilt [rad], rate [rad/s], stretch of a slider [rad])."""


@dataclass(frozen=True)
class Truth:
    """What is hidden in a log."""

    name: str
    effects: dict[str, tuple[float, ...]]
    light: bool = True
    outside: Torque | None = None
    """Torque that no effect of the catalogue makes."""
    memory: Callable[[float, float], float] | None = None
    """Rate of the slider's stretch from (rate, stretch) [rad/s]; it was dragged from rest to the release angle."""
    noise_of: Callable[[np.random.Generator, int, float], np.ndarray] | None = None
    """Sensor noise of unit size from (generator, samples, sampling period); white where None."""
    kin: tuple[str, ...] = ()
    """An effect of the catalogue whose family this truth belongs to: naming it is right too."""
    noises: tuple[float, ...] = NOISES_DEG
    rates: tuple[float, ...] = RATES

    @property
    def expected(self) -> frozenset[str]:
        return frozenset(self.effects)


def _both(name: str, *values: tuple[float, ...], heavy: Sequence[tuple[float, ...]] = ()) -> list[Truth]:
    light = [Truth(f"{name} {_text(v)}", {name: v}) for v in values]
    return light + [Truth(f"{name} {_text(v)}, heavy", {name: v}, light=False) for v in heavy]


def _text(values: tuple[float, ...]) -> str:
    return ",".join(f"{v:g}" for v in values)


TRUTHS: list[Truth] = [
    Truth("none", {}),
    Truth("none, heavy", {}, light=False),
    *_both("coulomb", (0.03,), (0.1,), heavy=[(0.15,)]),
    *_both("stribeck", (0.05, 0.2, 0.4)),
    *_both("quadratic-damping", (0.008,), (0.03,), heavy=[(0.1,)]),
    *_both("cubic-damping", (0.003,), (0.015,), heavy=[(0.05,)]),
    *_both("cubic-stiffness", (60.0,), (250.0,), (-60.0,), heavy=[(300.0,)]),
    *_both("asymmetric-stiffness", (8.0,), (-25.0,), heavy=[(40.0,)]),
    *_both("end-stop", (0.1, 40.0), (0.13, 100.0), heavy=[(0.08, 80.0)]),
    *_both("freeplay", (0.006,), (0.02,), heavy=[(0.02,)]),
    *_both("viscoelastic", (3.0, 0.06), (2.0, 0.3)),
    *_both("hysteresis", (6.0, 0.15), (15.0, 0.1)),
    *_both("second-mode", (0.004, 120.0, 0.05), (0.02, 150.0, 0.3), (0.02, 60.0, 0.1)),
    *_both("offset", (0.015,), heavy=[(-0.01,)]),
    *_both("preload", (0.2,)),
    *_both("sensor-bias", (-0.02,)),
    *_both("inertia", (1.3,), heavy=[(0.8,)]),
    *_both("gravity", (1.5,)),
    *_both("lowpass", (0.004,), (0.015,), heavy=[(0.01,)]),
    *_both("sensor-drift", (0.004,), (-0.02,), heavy=[(0.01,)]),
    *_both("clock", (1.06,), heavy=[(0.95,)]),
    Truth("discretisation 0.005, heavy", {"discretisation": (0.005,)}, light=False, rates=(100.0, 200.0)),
    Truth("coulomb and cubic-stiffness", {"coulomb": (0.08,), "cubic-stiffness": (150.0,)}),
    Truth("quadratic-damping and cubic-stiffness", {"quadratic-damping": (0.03,), "cubic-stiffness": (-120.0,)}),
    Truth("coulomb and asymmetric-stiffness", {"coulomb": (0.06,), "asymmetric-stiffness": (20.0,)}),
    Truth("freeplay and coulomb", {"freeplay": (0.015,), "coulomb": (0.05,)}),
    Truth("cogging", {}, outside=lambda t, x, v, z: -0.1 * np.sin(60 * x), noises=(0.04, 0.1)),
    Truth("magnet in the middle", {}, outside=lambda t, x, v, z: -12 * x / (1 + (x / 0.02) ** 2) ** 2, noises=(0.04, 0.1)),
    Truth("damper on one side", {}, outside=lambda t, x, v, z: -0.08 * max(v, 0.0), noises=(0.04, 0.1)),
    Truth("bumper on one side", {}, outside=lambda t, x, v, z: -25 * max(x - 0.06, 0.0), noises=(0.04, 0.1), kin=("one-sided-stop",)),
    Truth("spring that loosens", {}, outside=lambda t, x, v, z: 1.5 * x * (1 - np.exp(-t / 0.5)), noises=(0.04, 0.1)),
    Truth("friction like the root of the rate", {}, outside=lambda t, x, v, z: -0.09 * np.sign(v) * np.sqrt(abs(v)), noises=(0.04, 0.1)),
    Truth("damping by the tilt", {}, outside=lambda t, x, v, z: -0.6 * abs(x) * v, noises=(0.04, 0.1)),
    Truth("damping by the tilt squared", {}, outside=lambda t, x, v, z: -5.0 * x * x * v, noises=(0.04, 0.1)),
    Truth("stiffness of the fifth power", {}, outside=lambda t, x, v, z: -3000.0 * x**5, noises=(0.04, 0.1)),
    Truth("periodic torque", {}, outside=lambda t, x, v, z: 0.06 * np.sin(2 * np.pi * 3 * t), noises=(0.04, 0.1)),
    Truth("two stops", {}, outside=lambda t, x, v, z: -60 * (max(x - 0.12, 0.0) + min(x + 0.06, 0.0)), noises=(0.04, 0.1)),
    Truth("Bouc-Wen, round corners", {}, outside=lambda t, x, v, z: -8.0 * z, memory=lambda v, z: v - abs(v) * z / 0.02, noises=(0.04, 0.1), kin=("hysteresis",)),
    Truth("none, noise of 5 ms", {}, noise_of=lambda rng, n, h: _coloured(rng, n, h / 0.005)),
    Truth("none, noise of 30 ms", {}, noise_of=lambda rng, n, h: _coloured(rng, n, h / 0.03)),
    Truth("none, hum", {}, noise_of=lambda rng, n, h: np.sqrt(0.5) * rng.standard_normal(n) + np.sin(2 * np.pi * (50 * h * np.arange(n) + rng.random()))),
    Truth("none, coarse steps", {}, noise_of=lambda rng, n, h: np.zeros(n)),
]  # fmt: skip


def board_of(truth: Truth) -> Board:
    board = load_board(ROOT / "data/boards/pink.toml")
    return board.with_tilt(damping=Quantity(LIGHT, 2e-4, "N*m*s/rad")) if truth.light else board


def make(truth: Truth, seed: int, folder: Path, *, quiet: bool = False) -> list[Release]:
    """Return three releases of a truth; noise, rate and angles go by the seed; `quiet` leaves the noise out."""
    rng = np.random.default_rng(1000 + seed)
    noise = float(np.radians(rng.choice(truth.noises)))
    rate = float(rng.choice(truth.rates))
    angles = rng.uniform(0.85, 1.1, 3) * np.array([0.19, -0.15, 0.11])
    if truth.outside is not None or truth.noise_of is not None:
        return _integrated(truth, angles, rate, noise, rng, quiet=quiet)
    from sysid.synth import SynthOptions, synthesise
    from sysid.synth.sensors import Sensor

    options = SynthOptions(
        angles=tuple(map(float, angles)),
        rate=rate,
        duration=2.0,
        seed=seed,
        sensor=Sensor(noise=1e-9 if quiet else noise),
    )
    path = folder / f"{abs(hash(truth.name))}-{seed}-{quiet}.csv"
    synthesise(board_of(truth), truth.effects, options).save(path)
    return find_releases(read_roll(path))


def _integrated(
    truth: Truth, angles: np.ndarray, rate: float, noise: float, rng: np.random.Generator, *, quiet: bool
) -> list[Release]:
    from scipy.integrate import solve_ivp

    board, t = board_of(truth), np.arange(0, 2.0, 1 / rate)
    torque, memory = truth.outside or (lambda t, x, v, z: 0.0), truth.memory or (lambda v, z: 0.0)
    k, d, inertia = board.stiffness, board.damping, board.inertia.value
    releases: list[Release] = []
    for number, angle in enumerate(angles, start=1):
        dragged = _dragged(memory, angle)
        path = solve_ivp(
            lambda t, y: [y[1], (-k * y[0] - d * y[1] + torque(t, *y)) / inertia, memory(y[1], y[2])],
            (0, 2.0), [angle, 0.0, dragged], t_eval=t, method="DOP853", rtol=1e-8, atol=1e-10, max_step=2e-3,
        )  # fmt: skip
        roll = path.y[0]
        if quiet:
            pass
        elif truth.noise_of is None:
            roll = roll + noise * rng.standard_normal(len(t))
        else:
            roll = roll + noise * truth.noise_of(rng, len(t), 1 / rate)
        if truth.name.endswith("steps") and not quiet:
            step = 2 * noise
            roll = step * np.round((roll + 0.37 * step) / step)
        still = np.abs(path.y[0][-len(t) // 5 :]).max() < 0.3 * noise
        releases.append(
            Release(
                log=truth.name, number=number, time=t, roll=roll, std=np.full(len(t), noise), origin="angle",
                rest=0.0, hold=1.0, end="rest" if still else "log",
            )
        )  # fmt: skip
    return releases


def _dragged(memory: Callable[[float, float], float], angle: float) -> float:
    """Return the stretch of a slider that was dragged slowly from rest to an angle [rad]."""
    from scipy.integrate import solve_ivp

    side = float(np.sign(angle))
    path = solve_ivp(lambda x, z: [memory(side, z[0])], (0, abs(angle)), [0.0], rtol=1e-8, atol=1e-10)
    return float(path.y[0, -1])


def _coloured(rng: np.random.Generator, count: int, ratio: float) -> np.ndarray:
    """Return noise of unit variance whose correlation falls by e in 1/ratio samples."""
    from scipy.signal import lfilter

    a = np.exp(-ratio)
    white = rng.standard_normal(count + 200)
    return np.asarray(lfilter([np.sqrt(1 - a * a)], [1, -a], white))[200:]
