"""Makes driven_arm.csv: both joints of driven_arm.xml follow commands; the truth is in TRUTH, moved by formulas of its own."""

from pathlib import Path

import numpy as np

TRUTH = {
    "shoulder": {"armature": 0.0062, "damping": 0.24, "friction": 0.11, "delay": 0.012},
    "elbow": {"armature": 0.0021, "damping": 0.075, "friction": 0.04, "delay": 0.012},
}
"""kg·m², N·m·s/rad, N·m, s."""
GAINS = ((12.0, 0.3), (5.0, 0.08))
"""kp and kd of the two servos [N·m/rad, N·m·s/rad]."""
RATE, SECONDS, FINE, NOISE = 200, 12.0, 100, 5e-4
"""Samples a second, length [s], integration steps a sample, noise of the encoders [rad]."""
G, M1, M2, C1, C2, L1, J1, J2 = 9.81, 0.6, 0.3, 0.12, 0.1, 0.25, 0.004, 0.0015
"""Gravity, masses, centres of mass, length of the upper arm and inertias of driven_arm.xml [SI]."""


def command(t: np.ndarray) -> np.ndarray:
    """Return what both joints are told [rad], shape (n, 2)."""
    waves = [
        [(0.35, 0.31, 0.0), (0.25, 0.83, 1.0), (0.12, 1.7, 2.0), (0.05, 3.1, 0.5)],
        [(0.45, 0.43, 0.7), (0.3, 1.1, 0.2), (0.15, 2.2, 1.4), (0.06, 4.1, 2.9)],
    ]
    return np.stack([sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in one) for one in waves], axis=1)


def moved() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time [s], commands and angles [rad] of the true arm, by the double pendulum's equations."""
    t = np.arange(int(SECONDS * RATE)) / RATE
    u = command(t)
    armature, damping, friction, delay = (
        np.array([one[key] for one in TRUTH.values()]) for key in TRUTH["elbow"]
    )
    kp, kd = np.array(GAINS).T
    h = 1 / RATE / FINE
    q, v = np.array(u[0]), np.zeros(2)
    seen = np.empty_like(u)
    for i in range(len(t)):
        seen[i] = q
        for k in range(FINE):
            late = np.floor(((i + (k + 0.5) / FINE) / RATE - delay) * RATE + 1e-9).astype(int)
            told = u[np.clip(late, 0, None), (0, 1)]
            c2, s2 = np.cos(q[1]), np.sin(q[1])
            m12 = J2 + M2 * C2 * C2 + M2 * L1 * C2 * c2
            m22 = J2 + M2 * C2 * C2 + armature[1]
            m11 = J1 + M1 * C1**2 + M2 * L1**2 + M2 * L1 * C2 * c2 + m12 + armature[0]
            turn = M2 * L1 * C2 * s2
            spin = np.array([turn * (2 * v[0] * v[1] + v[1] ** 2), -turn * v[0] ** 2])
            far = M2 * G * C2 * np.sin(q[0] + q[1])
            weight = -np.array([(M1 * C1 + M2 * L1) * G * np.sin(q[0]) + far, far])
            torque = kp * (told - q) - kd * v - damping * v - friction * np.tanh(v / 2e-4) + spin + weight
            inverse = np.array([[m22, -m12], [-m12, m11]]) / (m11 * m22 - m12 * m12)
            # Dry friction is stiff: its slope is taken implicitly.
            slope = np.diag(damping + kd + friction / 2e-4 / np.cosh(np.clip(v / 2e-4, -300, 300)) ** 2)
            v = v + np.linalg.solve(np.eye(2) + h * inverse @ slope, h * inverse @ torque)
            q = q + h * v
    return t, u, seen


def main() -> None:
    """Write the log."""
    t, u, q = moved()
    q = q + NOISE * np.random.default_rng(7).standard_normal(q.shape)
    rows = np.column_stack([t, q, u])
    head = "time_s,q_shoulder_rad,q_elbow_rad,action_shoulder_rad,action_elbow_rad"
    np.savetxt(Path(__file__).with_name("driven_arm.csv"), rows, "%.5f", ",", header=head, comments="")


if __name__ == "__main__":
    main()
