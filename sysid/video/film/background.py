"""Patches of what stands still behind the board: they show how the camera shakes; and cuts."""

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video.film.camera import Lens
from sysid.video.film.frames import Frame, crop, grey
from sysid.video.film.shake import MIN_PATCHES, Shake, Sights, fit_rotations, still, whole_shake
from sysid.video.types import Complex, Mask, Picture

PATCH_GRID = (5, 4)
"""At most one patch of background in each cell of a grid this wide and high."""
HALF_PATCH = 16
"""Half a patch [px]."""
MAX_STEP = 24
"""How far a patch may move between two frames, against what the last frame suggests [px]."""
BATCH_FRAMES = 256
"""Frames that are worked out at once."""
CUT_CHANGE = 12.0
"""Mean change of brightness from frame to frame above which a cut is suspected [grey levels]."""
CUT_LIKENESS = 0.5
"""Correlation of two neighbouring frames below which the scene has been cut."""
FLOW_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.01)


@dataclass(slots=True)
class Background:
    """Follows patches of what stands still, always against the first frame, so that nothing drifts."""

    spare: Mask
    """Pixels where the board may come, as large as the picture: no patch reaches into them."""
    lens: Lens
    _anchors: Array = field(default_factory=lambda: np.zeros((0, 2)))
    _reference: Picture | None = None
    _places: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """Where the patches were seen last [px]."""
    _waiting: list[Array] = field(default_factory=list)
    """Places in frames whose rotation is not worked out yet [px], each (m, 2)."""
    _sights: list[Sights] = field(default_factory=list)
    _count: int = 0
    _thumb: npt.NDArray[np.float32] | None = None

    def update(self, frame: Frame) -> None:
        """Take in one more frame.

        Raises:
            SysidError: The picture changes all at once.
        """
        self._refuse_cut(frame)
        if self._reference is None:
            self._choose(frame.picture)
        self._count += 1
        if len(self._anchors) < MIN_PATCHES:
            return
        self._waiting.append(self._follow(frame.picture))
        if len(self._waiting) == BATCH_FRAMES:
            self._work_out()

    def result(self) -> Shake:
        """Return the motion over all frames so far."""
        if self._waiting:
            self._work_out()
        if len(self._anchors) < MIN_PATCHES:
            return still(self._count, self._focal, self._centre)
        return whole_shake(self._sights, self._focal, self._centre, known=self.lens.known)

    def _work_out(self) -> None:
        """Turn places into rotations; many frames at once take little longer than one."""
        seen = self.lens.straighten(np.array(self._waiting))
        home = self.lens.straighten(self._anchors)
        self._sights.append(fit_rotations(self._about_middle(home), self._about_middle(seen), self._focal))
        self._waiting.clear()

    def _about_middle(self, places: Array) -> Complex:
        return places[..., 0] + 1j * places[..., 1] - self._centre

    @property
    def _focal(self) -> float:
        return float(self.lens.matrix[0, 0])

    @property
    def _centre(self) -> complex:
        return complex(self.lens.matrix[0, 2], self.lens.matrix[1, 2])

    def _refuse_cut(self, frame: Frame) -> None:
        step = max(frame.picture.shape[0] // 36, 1)
        thumb = frame.picture[step // 2 :: step, step // 2 :: step, 1].astype(np.float32).ravel()
        before, self._thumb = self._thumb, thumb
        if before is None or np.abs(thumb - before).mean() < CUT_CHANGE:
            return
        if float(np.corrcoef(thumb, before)[0, 1]) < CUT_LIKENESS:
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
        board = cv2.resize(self.spare.astype(np.uint8), small.shape[::-1], interpolation=cv2.INTER_AREA)
        quality[cv2.dilate(board, np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)) > 0] = 0
        quality[:margin], quality[-margin:], quality[:, :margin], quality[:, -margin:] = 0, 0, 0, 0
        anchors: list[tuple[int, int]] = []
        for rows in np.array_split(np.arange(quality.shape[0]), PATCH_GRID[1]):
            for columns in np.array_split(np.arange(quality.shape[1]), PATCH_GRID[0]):
                cell = quality[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
                row, column = np.unravel_index(np.argmax(cell), cell.shape)
                if cell[row, column] > 1e-4:
                    anchors.append((int((columns[0] + column) * scale), int((rows[0] + row) * scale)))
        self._anchors = np.array(anchors, np.float64).reshape(-1, 2)
        self._places = self._anchors
        self._reference = self._mosaic(picture, self._anchors) if anchors else dark

    def _follow(self, picture: Picture) -> Array:
        """Find every patch near where it was last, shape (m, 2) [px]; NaN where it is not found."""
        centre = np.round(self._places)
        inside = np.all((centre >= 0) & (centre < np.array(picture.shape[1::-1])), axis=1)
        size = 2 * (HALF_PATCH + MAX_STEP) + 1
        middle = np.arange(len(centre)) * size + HALF_PATCH + MAX_STEP
        start = np.stack([middle, np.full(len(centre), HALF_PATCH + MAX_STEP)], axis=1).astype(np.float32)
        assert self._reference is not None
        moved, good, _ = cv2.calcOpticalFlowPyrLK(
            self._reference, self._mosaic(picture, centre), start[:, None], start[:, None].copy(),
            winSize=(2 * HALF_PATCH + 1, 2 * HALF_PATCH + 1), maxLevel=2,
            criteria=FLOW_CRITERIA, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )  # fmt: skip
        step = (moved[:, 0] - start).astype(np.float64)
        found = (good.ravel() > 0) & inside & (np.abs(step).max(axis=1) < MAX_STEP)
        seen = centre + step
        if found.any():
            # The camera takes all along: one that is lost is looked for where the others went.
            went = np.sort((seen - self._places)[found], axis=0)[found.sum() // 2]
            self._places = np.where(found[:, None], seen, self._places + went)
        return np.where(found[:, None], seen, np.nan)

    def _mosaic(self, picture: Picture, centres: Array) -> Picture:
        """Put the surroundings of every place side by side, in grey."""
        reach = HALF_PATCH + MAX_STEP
        size = 2 * reach + 1
        mosaic = np.zeros((size, size * len(centres), *picture.shape[2:]), np.uint8)
        for number, (x, y) in enumerate(centres.astype(int).tolist()):
            part, (left, top) = crop(picture, (x - reach, y - reach, x + reach + 1, y + reach + 1))
            if part.size:
                row, column = top - (y - reach), number * size + left - (x - reach)
                mosaic[row : row + part.shape[0], column : column + part.shape[1]] = part
        return grey(mosaic)
