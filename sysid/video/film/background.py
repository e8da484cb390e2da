"""Patches all over the picture, followed from frame to frame: those that stand still show how the camera shakes; and cuts."""

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video.film.camera import Lens
from sysid.video.film.frames import Frame, crop, grey
from sysid.video.film.shake import MIN_FRAMES_SEEN, MIN_PATCHES, Shake, fit_rotations, still, whole_shake
from sysid.video.types import Complex, Mask, Picture

PATCH_GRID, CELL_PATCHES = (8, 6), 2
"""At most so many patches in each cell of a grid this wide and high: one may lie on the board."""
HALF_PATCH = 12
"""Half a patch [px]."""
MAX_STEP = 24
"""How far a patch may move between two frames, against what the last frame suggests [px]."""
SIZE = 2 * (HALF_PATCH + MAX_STEP) + 1
"""Width and height of what is looked through for a patch [px]."""
BATCH_FRAMES = 256
"""Frames that are worked out at once: that takes little longer than one."""
CUT_CHANGE = 12.0
"""Mean change of brightness from frame to frame above which a cut is suspected [grey levels]."""
CUT_LIKENESS, CUT_SIDE = 0.5, 160
"""Correlation of two neighbouring frames, one shifted onto the other, below which the scene has been cut; and the long side
of the small pictures that are compared [px]."""
MAX_GOING = 0.5
"""Correlation of a patch's steps with the board's turn from frame to frame above which it lies on the board, or in its shadow."""
MAX_ROUGHNESS = 2.0
"""A patch that jumps so many times as far from frame to frame as the few best ones shows noise."""
FLOW_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.01)


@dataclass(slots=True)
class Background:
    """Follows patches, always against the first frame, so that nothing drifts."""

    lens: Lens
    _anchors: Array = field(default_factory=lambda: np.zeros((0, 2)))
    _reference: Picture | None = None
    _places: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """Where the patches were seen last [px]."""
    _seen: list[npt.NDArray[np.float32]] = field(default_factory=list)
    """Places in each frame [px], each (m, 2)."""
    _followed: Mask | None = None
    """Which patches are looked for; all as long as it is not known where the board moves."""
    _still: Mask | None = None
    """Which patches lie where nothing moves, as far as that is known."""
    _before: Picture | None = None
    """The frame before."""

    def update(self, frame: Frame) -> Array:
        """Take in one more frame; return how far most patches have moved since the first one [px], shape (2,).

        Raises:
            SysidError: The picture changes all at once.
        """
        self._refuse_cut(frame)
        if self._reference is None:
            self._choose(frame.picture)
        self._seen.append(self._follow(frame.picture).astype(np.float32))
        return self.shift(len(self._seen) - 1)

    def shift(self, number: int) -> Array:
        """Return how far most patches have moved from the first frame to another one [px], shape (2,)."""
        moved = (self._seen[number] - self._anchors)[self._still if self._still is not None else slice(None)]
        moved = moved[np.isfinite(moved).all(axis=1)]
        return np.median(moved, axis=0) if len(moved) >= MIN_PATCHES else np.zeros(2)

    def leave_out(self, spare: Mask, first: int = 0, turn: Array | None = None) -> None:
        """Let no patch count from now on that reaches into the board, moves with it, or holds but noise.

        Args:
            spare: Pixels in which the board moves, shape (height, width) [1].
            first: Number of the first of n frames.
            turn: The board's turn in them [rad], shape (n,).
        """
        near = cv2.boxFilter(spare.astype(np.uint8), -1, (SIZE, SIZE), normalize=False) > 0
        x, y = self._anchors.T.astype(int)
        alone = self._followed = np.asarray(~near[y, x], np.bool_)
        if turn is not None and alone.any():
            alone = self._apart(np.array(self._seen[first : first + len(turn)], np.float64), alone, turn)
        self._still = alone

    def _apart(self, seen: Array, some: Mask, turn: Array) -> Mask:
        """Return which of some patches, seen at (n, m, 2) [px], neither move with the board's turn (n,) [rad] nor hold but noise."""
        step = np.diff(seen, axis=0)
        found = np.asarray(np.isfinite(step).all(axis=2), np.bool_)
        some = some & (found.mean(axis=0) > MIN_FRAMES_SEEN)
        if not some.any():
            return some
        step = np.where(found[..., None], step, 0.0)
        size = np.sqrt((step**2).sum(axis=0)) * np.linalg.norm(np.diff(turn))
        going = np.abs(np.einsum("n,npa->pa", np.diff(turn), step)) / np.maximum(size, 1e-9)
        own = step - np.median(step[:, some], axis=1, keepdims=True)
        rough = np.median(np.abs(own).max(axis=2), axis=0)
        usual = np.sort(rough[some])[: 2 * MIN_PATCHES][-1]
        return some & (going.max(axis=1) < MAX_GOING) & (rough < MAX_ROUGHNESS * usual + 0.05)

    def shake(self, first: int, stop: int) -> Shake:
        """Return the motion of the frames from number `first` up to `stop`, against the first of the film."""
        if self._still is None or self._still.sum() < MIN_PATCHES:
            return still(stop - first, self._focal, self._centre)
        still_ones = self._still
        home = self._about_middle(self.lens.straighten(self._anchors[still_ones]))
        sights = [
            fit_rotations(
                home, self._about_middle(self.lens.straighten(np.array(some)[:, still_ones].astype(float))), self._focal
            )
            for some in (self._seen[at : min(at + BATCH_FRAMES, stop)] for at in range(first, stop, BATCH_FRAMES))
        ]  # fmt: skip
        return whole_shake(sights, self._focal, self._centre, known=self.lens.known)

    def _about_middle(self, places: Array) -> Complex:
        return places[..., 0] + 1j * places[..., 1] - self._centre

    @property
    def _focal(self) -> float:
        return float(self.lens.matrix[0, 0])

    @property
    def _centre(self) -> complex:
        return complex(self.lens.matrix[0, 2], self.lens.matrix[1, 2])

    def _refuse_cut(self, frame: Frame) -> None:
        before, self._before = self._before, frame.picture
        if before is None:
            return
        step = max(frame.picture.shape[0] // 36, 1)
        sample = (slice(step // 2, None, step), slice(step // 2, None, step), 1)
        change = np.abs(frame.picture[sample].astype(np.float32) - before[sample])
        if change.mean() < CUT_CHANGE:
            return
        scale = CUT_SIDE / max(frame.picture.shape[:2])
        now, then = (
            cv2.resize(grey(one), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            for one in (frame.picture, before)
        )
        height, width = (side // 5 for side in now.shape)  # a camera that pans shows most of it again
        inner = now[height : now.shape[0] - height, width : now.shape[1] - width]
        if float(cv2.matchTemplate(then, inner, cv2.TM_CCOEFF_NORMED).max()) < CUT_LIKENESS:
            raise SysidError(
                f"the whole picture changes at {frame.time:.2f} s (frame {frame.index}): a cut. "
                "Give one uncut take; trim the film first."
            )

    def _choose(self, picture: Picture) -> None:
        height, width = picture.shape[:2]
        dark = grey(picture)
        scale = max(1, width // 640)
        small = cv2.resize(dark, (width // scale, height // scale), interpolation=cv2.INTER_AREA)
        quality = cv2.cornerMinEigenVal(cv2.GaussianBlur(small, (0, 0), 1.0), 7)
        margin = (HALF_PATCH + MAX_STEP) // scale + 2
        quality[:margin], quality[-margin:], quality[:, :margin], quality[:, -margin:] = 0, 0, 0, 0
        anchors: list[tuple[int, int]] = []
        for rows in np.array_split(np.arange(quality.shape[0]), PATCH_GRID[1]):
            for columns in np.array_split(np.arange(quality.shape[1]), PATCH_GRID[0]):
                cell = quality[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
                for _ in range(CELL_PATCHES):
                    row, column = np.unravel_index(np.argmax(cell), cell.shape)
                    if cell[row, column] > 1e-4:
                        anchors.append((int((columns[0] + column) * scale), int((rows[0] + row) * scale)))
                    apart = 2 * HALF_PATCH // scale
                    cell[
                        max(row - apart, 0) : row + apart + 1, max(column - apart, 0) : column + apart + 1
                    ] = 0
        self._anchors = np.array(anchors, np.float64).reshape(-1, 2)
        self._places = self._anchors.copy()
        self._reference = self._mosaic(picture, self._anchors)

    def _follow(self, picture: Picture) -> Array:
        """Find patches near where they were last, shape (m, 2) [px]; NaN where one is not found, or looked for."""
        places = np.full_like(self._anchors, np.nan)
        followed = self._followed  # told by another thread, some time
        some = np.arange(len(places)) if followed is None else np.flatnonzero(followed)
        if not len(some):
            return places
        centre = np.round(self._places[some])
        inside = np.all((centre >= 0) & (centre < np.array(picture.shape[1::-1])), axis=1)
        assert self._reference is not None
        reference = self._reference.reshape(SIZE, -1, SIZE)[:, some].reshape(SIZE, -1)
        start = (np.arange(len(some))[:, None] * [SIZE, 0] + SIZE // 2).astype(np.float32)[:, None]
        moved, good, _ = cv2.calcOpticalFlowPyrLK(
            reference, self._mosaic(picture, centre), start, start.copy(),
            winSize=(2 * HALF_PATCH + 1, 2 * HALF_PATCH + 1), maxLevel=2,
            criteria=FLOW_CRITERIA, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )  # fmt: skip
        step = (moved - start)[:, 0].astype(np.float64)
        found = (good.ravel() > 0) & inside & (np.abs(step).max(axis=1) < MAX_STEP)
        seen = centre + step
        if found.any():
            # The camera takes all along: one that is lost is looked for where the others went.
            went = np.sort((seen - self._places[some])[found], axis=0)[found.sum() // 2]
            self._places[some] = np.where(found[:, None], seen, self._places[some] + went)
        places[some] = np.where(found[:, None], seen, np.nan)
        return places

    def _mosaic(self, picture: Picture, centres: Array) -> Picture:
        """Put the surroundings of every place side by side, in grey."""
        reach = SIZE // 2
        mosaic = np.zeros((SIZE, SIZE * len(centres), *picture.shape[2:]), np.uint8)
        for number, (x, y) in enumerate(centres.astype(int).tolist()):
            part, (left, top) = crop(picture, (x - reach, y - reach, x + reach + 1, y + reach + 1))
            if part.size:
                row, column = top - (y - reach), number * SIZE + left - (x - reach)
                mosaic[row : row + part.shape[0], column : column + part.shape[1]] = part
        return grey(mosaic)
