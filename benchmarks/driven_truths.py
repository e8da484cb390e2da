"""Random driven joints with a hidden effect, moved by formulas of their own: no code of the fit takes part.

Rotor and joint are two bodies on a stiff gear, or one; time steps are semi-implicit and far finer than the samples.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from sysid.driven.log import DrivenLog, Load

HIDDEN = ("", "friction", "delay", "saturation", "backlash", "compliance", "cogging")
"""Families that are hidden, in turn; nothing at first."""
FINE = 20_000.0
"""Steps a second."""
TURNS = 100
"""Turns beyond which a draw is unstable."""


@dataclass
class Truth:
    """A joint, how it is driven, and what is hidden in it."""

    hidden: tuple[str, ...]
    kind: str
    inertia: float
    armature: float
    damping: float
    weight: float
    kp: float = 0.0
    kd: float = 0.0
    bias: float = 0.0
    own: dict[str, float] = field(default_factory=dict)
    encoder: str = "joint"


def signal(rng: np.random.Generator, seconds: float, rate: float, band: float) -> np.ndarray:
    """Return an input in [-1, 1]: a sum of sines, a chirp, or steps of random height."""
    t = np.arange(round(seconds * rate)) / rate
    form = rng.integers(3)
    if form == 0:
        parts = [
            rng.uniform(0.3, 1) * np.sin(2 * np.pi * f * t + rng.uniform(0, 7))
            for f in band * np.geomspace(0.1, 1, 7)
        ]
        u = np.sum(parts, axis=0)
    elif form == 1:
        phase = 2 * np.pi * (0.1 * band * t + 0.9 * band * t**2 / 2 / seconds)
        u = np.sin(phase) * (1 + 0.5 * np.sin(2 * np.pi * t / seconds * 3))
    else:
        every = rng.uniform(0.4, 1.0) / band
        u = rng.uniform(-1, 1, int(seconds / every) + 2)[(t / every).astype(int)]
        u = u + 0.2 * np.sin(2 * np.pi * band * t)
    return u / np.abs(u).max()


def draw(rng: np.random.Generator, hidden: tuple[str, ...]) -> Truth:
    """Return a random joint with those effects."""
    kind = ["torque", "command"][rng.integers(2)]
    inertia = 10 ** rng.uniform(-2.5, 0)
    armature = inertia * 10 ** rng.uniform(-1, 0.5)
    total = inertia + armature
    weight = inertia * 9.81 / rng.uniform(0.1, 0.5) * rng.integers(2)
    omega = 2 * np.pi * rng.uniform(2.0, 6.0)
    truth = Truth(
        hidden, kind, inertia, armature, damping=total * omega * rng.uniform(0.05, 0.4), weight=weight
    )
    if kind == "command":
        truth.kp, truth.kd = total * omega**2 + weight, total * omega * rng.uniform(0.2, 0.8)
    else:
        truth.damping *= 2
    return truth


def simulate(truth: Truth, u: np.ndarray, rate: float) -> np.ndarray:
    """Return the angle that the encoder sees at the samples of an input that is held between them."""
    own, sub = truth.own, max(1, round(FINE / rate))
    h = 1 / rate / sub
    J, A, d, w, kp, kd = truth.inertia, truth.armature, truth.damping, truth.weight, truth.kp, truth.kd
    F, L = own.get("friction", 0.0), own.get("limit", math.inf)
    K, D, gap = own.get("K", 0.0), own.get("D", 0.0), own.get("gap", 0.0)
    s, n, phase = own.get("cog", 0.0), own.get("teeth", 0.0), own.get("phase", 0.0)
    late = own.get("delay", 0.0) * rate
    two, command = K > 0, truth.kind == "command"
    q = v = th = om = 0.0
    out = np.empty(len(u))
    steps = np.clip(np.floor((np.arange(len(u) * sub) + 0.5) / sub - late), 0, None).astype(int)
    inputs = u[steps]
    k = 0
    motor = truth.encoder == "motor"
    for i in range(len(u)):
        out[i] = th if two and motor else q
        for _ in range(sub):
            x, r = (th, om) if two and motor else (q, v)
            tau = kp * (inputs[k] - x) - kd * r if command else inputs[k]
            tau = min(max(tau, -L), L) + s * math.sin(n * x + phase) + truth.bias
            pull = -w * math.sin(q)
            if two:
                twist = th - q
                beyond = twist - min(max(twist, -gap), gap)
                passed = K * beyond + (D * (om - v) if abs(twist) > gap or gap == 0 else 0.0)
                om1 = (om + h / A * (tau - passed)) / (1 + h * d / A)
                om1 = math.copysign(max(abs(om1) - h * F / A, 0.0), om1)
                th += h * (om + om1) / 2
                om = om1
                v1 = v + h / J * (pull + passed)
            else:
                v1 = (v + h / (J + A) * (tau + pull)) / (1 + h * d / (J + A))
                v1 = math.copysign(max(abs(v1) - h * F / (J + A), 0.0), v1)
            q += h * (v + v1) / 2
            v = v1
            k += 1
    return out


def make(seed: int, hidden: tuple[str, ...]) -> tuple[Truth, DrivenLog]:
    """Return a truth and its log: 8 to 14 s at 200 to 500 Hz, noise of 0.02 to 0.2 % of the motion.

    A servo on a soft gear may be unstable; the next draw is taken then.
    """
    rng = np.random.default_rng(seed)
    while True:
        truth, log = _made(rng, hidden, seed)
        if np.abs(log.angle).max() < 2 * np.pi * TURNS:
            return truth, log


def _made(rng: np.random.Generator, hidden: tuple[str, ...], seed: int) -> tuple[Truth, DrivenLog]:
    truth = draw(rng, hidden)
    rate, seconds = float(rng.choice([200.0, 250.0, 500.0])), rng.uniform(8, 14)
    total = truth.inertia + truth.armature
    omega = math.sqrt((truth.kp or truth.weight + total * 9.0) / total)
    band = min(1.6 * omega / 2 / math.pi, rate / 12)
    u = signal(rng, seconds, rate, band)
    if truth.kind == "command":
        u *= rng.uniform(0.4, 1.2)
    else:
        u *= total * omega**2 * rng.uniform(0.5, 1.0)
    plain = simulate(truth, u, rate)
    tau = truth.kp * (u - plain) - truth.kd * np.gradient(plain, 1 / rate) if truth.kind == "command" else u
    strong, reach = float(np.quantile(np.abs(tau), 0.98)), float(np.std(plain))
    for one in hidden:
        if one == "friction":
            truth.own["friction"] = strong * rng.uniform(0.06, 0.3)
        if one == "delay":
            truth.own["delay"] = rng.uniform(0.05, 0.3) / omega
        if one == "saturation":
            truth.own["limit"] = strong * rng.uniform(0.35, 0.75)
        if one == "compliance":
            soft = 1 / (1 / truth.inertia + 1 / truth.armature)
            truth.own["K"] = soft * (omega * rng.uniform(2.5, 6)) ** 2
            truth.own["D"] = 2 * rng.uniform(0.02, 0.15) * math.sqrt(truth.own["K"] * soft)
        if one == "backlash":
            soft = 1 / (1 / truth.inertia + 1 / truth.armature)
            truth.own["K"] = soft * (omega * rng.uniform(15, 30)) ** 2
            truth.own["D"] = 2 * rng.uniform(0.1, 0.4) * math.sqrt(truth.own["K"] * soft)
            truth.own["gap"] = reach * rng.uniform(0.03, 0.12)
        if one == "cogging":
            truth.own |= {
                "cog": strong * rng.uniform(0.05, 0.2),
                "teeth": float(rng.integers(6, 30)),
                "phase": rng.uniform(0, 6),
            }
    angle = simulate(truth, u, rate)
    std = float(np.std(angle)) * 10 ** rng.uniform(-3.7, -2.7)
    measured = angle + std * rng.standard_normal(len(angle))
    load = Load(inertia=np.full(len(u), truth.inertia), torque=-truth.weight * np.sin(measured),
                slope=-truth.weight * np.cos(measured), at=measured)  # fmt: skip
    return truth, DrivenLog(name=f"{'+'.join(hidden) or 'clean'}-{seed}", time=np.arange(len(u)) / rate, angle=measured, std=std,
                            input=u, kind=truth.kind, load=load)  # type: ignore[arg-type]  # fmt: skip


def given(truth: Truth) -> dict[str, float]:
    """Return what the model of that joint states: the gains of its servo."""
    if truth.kind != "command":
        return {}
    from sysid.effects import servo_gains

    return {f"{servo_gains.EFFECT.name}.kp": truth.kp, f"{servo_gains.EFFECT.name}.kd": truth.kd}
