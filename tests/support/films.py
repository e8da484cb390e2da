"""Small rendered films with known roll, made once for the whole test run."""

import fcntl
import pickle
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from film import Camera, film
from film_set import Mark, Motion, rock

from sysid.roll import Array, Roll
from sysid.workspace import Workspace

SMALL = Camera(width=640, height=360, pitch_deg=6.0, focal=1.4)
REALISTIC = Camera(
    width=640, height=360, focal=1.4, yaw_deg=5.0, pitch_deg=7.0, roll_deg=1.5, exposure=1 / 240, noise=2.0,
    jitter=0.1, readout=0.01, shake_deg=0.08,
)  # fmt: skip


FILMS: dict[str, tuple[Mark, Camera]] = {
    "marker": ("marker", SMALL),
    "realistic": ("marker", REALISTIC),
    "dots": ("dots", replace(SMALL, noise=2.0)),
    "edge": ("edge", replace(SMALL, noise=2.0)),
    "features": ("none", replace(SMALL, noise=2.0)),
}
"""What more than one test looks at: mark and camera."""


@dataclass(frozen=True)
class TestFilm:
    """A film and the truth behind it."""

    __test__ = False

    path: Path
    motion: Motion
    stamps: Array
    camera: Camera

    def error(self, roll: Roll) -> Array:
        """Error of the roll [rad] but for the clock's constant offset and the rest angle."""
        start = self.stamps[0] + self.camera.readout / 2

        def error(offset: float) -> Array:
            difference = roll.roll - self.motion.at(roll.time + start + offset)
            return difference - np.median(difference[-15:])

        return error(min(np.linspace(-0.008, 0.008, 801), key=lambda o: np.sum((error(o) / roll.std) ** 2)))


def shared_film(folder: Path, name: str) -> TestFilm:
    """Return a film of `FILMS`; of all processes that share the folder, the first to ask renders it."""
    made = folder / f"{name}.pickle"
    with (folder / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            made.write_bytes(pickle.dumps(make_film(folder, name, *FILMS[name])))
    return pickle.loads(made.read_bytes())


def make_film(folder: Path, name: str, mark: Mark, camera: Camera, duration: float = 0.9) -> TestFilm:
    """Film one release of the compliant board."""
    board = Workspace(Path()).load_board("pink")
    motion = rock(board, duration, ((0.2, 0.4),))
    path = folder / f"{name}.mp4"
    return TestFilm(path, motion, film(path, board, motion, mark, camera), camera)
