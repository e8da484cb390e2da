"""What the camera itself does: shake, read off the background, and cuts."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from sysid.errors import HuskyError
from sysid.roll import Array
from sysid.video.frames import Frame, Picture, crop, grey
from sysid.video.turning import Complex

GRID = (5, 4)
"""At most one patch of background in each cell of a grid this wide and high."""
HALF = 20
"""Half a patch [px]."""
REACH = 24
"""How far a patch may move between two frames, against what the last frame suggests [px]."""
FEWEST = 4
CUT_LIKENESS = 0.5
"""Correlation of two neighbouring frames below which the scene has been cut."""

PRECISION = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.01)


@dataclass(frozen=True, slots=True)
class Shake:
    """Motion of the picture against the first frame: x' = turn · x + shift, in complex pixels."""

    turn: Complex
    """Complex factor: the camera's rotation about its axis (and a little zoom), shape (n,); 1 where unknown."""
    shift: Complex
    """Complex shift [px], shape (n,)."""
    std: Array
    """Standard deviation of the rotation [rad], shape (n,)."""
    found: bool
    """Whether there was enough background to see any of it."""

    @property
    def rotation(self) -> Array:
        """The picture's rotation, clockwise [rad], shape (n,)."""
        return np.angle(self.turn)

    @property
    def significant(self) -> bool:
        """Whether the camera moved by more than what noise alone would show."""
        noise = float(np.sqrt(np.mean(self.std**2)))
        return self.found and float(np.std(self.rotation)) > 2.5 * noise + 1e-5

    def undo(self, points: Array) -> Array:
        """Return points (n, N, 2) [px] where they would be with the camera still."""
        place = points[..., 0] + 1j * points[..., 1]
        still = (place - self.shift[:, None]) / self.turn[:, None]
        return np.stack([still.real, still.imag], axis=-1)


@dataclass(slots=True)
class Background:
    """Follows patches of what stands still, always against the first frame, so that nothing drifts."""

    exclude: tuple[int, int, int, int]
    """Left, top, right and bottom [px] of where the board moves."""
    _anchors: Array = field(default_factory=lambda: np.zeros((0, 2)))
    _reference: Picture | None = None
    _turn: complex = 1 + 0j
    _shift: complex = 0j
    _history: list[tuple[complex, complex, float]] = field(default_factory=list)
    _thumb: Array | None = None

    def update(self, frame: Frame) -> None:
        """Take in one more frame.

        Raises:
            HuskyError: The picture changes all at once.
        """
        self._refuse_cut(frame)
        if self._reference is None:
            self._choose(frame.picture)
        result = self._follow(frame.picture) if len(self._anchors) >= FEWEST else None
        if result is not None:
            self._turn, self._shift = result[0], result[1]
        self._history.append(result or (self._turn, self._shift, np.nan))

    def result(self) -> Shake:
        """Return the motion over all frames so far."""
        turn, shift, std = (np.array(column) for column in zip(*self._history, strict=True))
        known = np.isfinite(std)
        worst = float(np.max(std[known])) if known.any() else 0.0
        return Shake(turn, shift, np.where(known, std, worst), bool(known.mean() > 0.8))

    def _refuse_cut(self, frame: Frame) -> None:
        step = max(frame.picture.shape[0] // 36, 1)
        thumb = frame.picture[step // 2 :: step, step // 2 :: step].astype(np.float64).ravel()
        before, self._thumb = self._thumb, thumb
        if before is None:
            return
        spread = thumb.std() * before.std()
        likeness = np.mean((thumb - thumb.mean()) * (before - before.mean())) / max(spread, 1e-9)
        if likeness < CUT_LIKENESS and np.abs(thumb - before).mean() > 12:
            raise HuskyError(
                f"the whole picture changes at {frame.time:.2f} s (frame {frame.index}): a cut. "
                "Give one uncut take; trim the film first."
            )

    def _choose(self, picture: Picture) -> None:
        height, width = picture.shape[:2]
        dark = grey(picture)
        scale = max(1, width // 640)
        small = cv2.resize(dark, (width // scale, height // scale), interpolation=cv2.INTER_AREA)
        quality = cv2.cornerMinEigenVal(cv2.GaussianBlur(small, (0, 0), 1.0), 7)
        left, top, right, bottom = (value // scale for value in self.exclude)
        margin = (HALF + REACH) // scale + 2
        quality[max(top - margin, 0) : bottom + margin, max(left - margin, 0) : right + margin] = 0
        quality[:margin], quality[-margin:], quality[:, :margin], quality[:, -margin:] = 0, 0, 0, 0
        anchors: list[tuple[int, int]] = []
        for rows in np.array_split(np.arange(quality.shape[0]), GRID[1]):
            for columns in np.array_split(np.arange(quality.shape[1]), GRID[0]):
                cell = quality[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
                row, column = np.unravel_index(np.argmax(cell), cell.shape)
                if cell[row, column] > 1e-4:
                    anchors.append((int((columns[0] + column) * scale), int((rows[0] + row) * scale)))
        self._anchors = np.array(anchors, np.float64).reshape(-1, 2)
        self._reference = self._mosaic(picture, self._anchors)

    def _follow(self, picture: Picture) -> tuple[complex, complex, float] | None:
        """Fit turn and shift to the patches, by least squares with weights that ignore movers."""
        home = self._anchors[:, 0] + 1j * self._anchors[:, 1]
        expected = self._turn * home + self._shift
        centre = np.round(np.stack([expected.real, expected.imag], axis=1))
        inside = np.all((centre >= 0) & (centre < np.array(picture.shape[1::-1])), axis=1)
        size = 2 * (HALF + REACH) + 1
        middle = np.arange(len(home)) * size + HALF + REACH
        start = np.stack([middle, np.full(len(home), HALF + REACH)], axis=1).astype(np.float32)
        assert self._reference is not None
        moved, good, _ = cv2.calcOpticalFlowPyrLK(
            self._reference, self._mosaic(picture, centre), start[:, None], start[:, None].copy(),
            winSize=(2 * HALF + 1, 2 * HALF + 1), maxLevel=2,
            criteria=PRECISION, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )  # fmt: skip
        step = (moved[:, 0] - start).astype(np.float64)
        good = (good.ravel() > 0) & inside & (np.abs(step).max(axis=1) < REACH)
        seen = (centre[:, 0] + step[:, 0]) + 1j * (centre[:, 1] + step[:, 1])
        return _similarity(home[good], seen[good])

    def _mosaic(self, picture: Picture, centres: Array) -> Picture:
        reach = HALF + REACH
        size = 2 * reach + 1
        mosaic = np.zeros((size, size * len(centres)), np.uint8)
        for number, (x, y) in enumerate(centres.astype(int)):
            part, (left, top) = crop(picture, (x - reach, y - reach, x + reach + 1, y + reach + 1))
            if part.size:
                row, column = top - (y - reach), number * size + left - (x - reach)
                mosaic[row : row + part.shape[0], column : column + part.shape[1]] = grey(part)
        return mosaic


def _similarity(home: Complex, seen: Complex) -> tuple[complex, complex, float] | None:
    if len(home) < FEWEST:
        return None
    weight = np.ones(len(home))
    turn, a, scale = 1 + 0j, 0j, 0.0
    shift = complex(np.median((seen - home).real), np.median((seen - home).imag))
    for _ in range(8):
        residual = np.abs(seen - turn * home - shift)
        scale = 1.4826 * float(np.median(residual)) + 0.02
        weight = 1 / (1 + (residual / (2 * scale)) ** 2) ** 2
        total = weight.sum()
        a, b = (weight * home).sum() / total, (weight * seen).sum() / total
        turn = complex(
            (weight * np.conj(home - a) * (seen - b)).sum() / (weight * np.abs(home - a) ** 2).sum()
        )
        shift = complex(b - turn * a)
    if scale > 1.5:
        return None
    spread = (weight * np.abs(home - a) ** 2).sum()
    return turn, shift, float(scale / np.sqrt(2) / np.sqrt(spread) * 1.4)
