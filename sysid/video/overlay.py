"""An annotated clip and a contact sheet: they show people the points that were followed."""

from pathlib import Path

import cv2
import numpy as np

from sysid.errors import SysidError
from sysid.files import atomic_path
from sysid.roll import Array, Roll
from sysid.video.film.frames import SURVEY_FRAMES, Clip
from sysid.video.film.track import Track
from sysid.video.types import Picture, Rows

Colour = tuple[int, ...]
"""In OpenCV's order: blue, green, red."""
SEEN_COLOUR, LOST_COLOUR = (tuple(bytes.fromhex(one)) for one in ("009fe6", "3c3cff"))
"""Orange, as all measurements, and red for points not seen in this frame."""
CODECS = {".mp4": "mp4v", ".mov": "mp4v", ".avi": "MJPG", ".mkv": "mp4v"}


def draw_overlay(
    clip: Clip,
    track: Track,
    roll: Roll,
    rows: Rows,
    path: Path,
    joined: tuple[tuple[int, int], ...] = (),
) -> None:
    """Write the clip with points [px], angle and trace drawn in, and `<path>.png` with some frames of it.

    Each sample of the roll is from a row of the track, shape (m,). Lines are drawn between the points `joined`.

    Raises:
        SysidError: The clip cannot be written.
    """
    codec = CODECS.get(path.suffix.lower())
    if codec is None:
        raise SysidError(f"--overlay {path}: a film ends with {', '.join(CODECS)}.")
    size = (clip.width, clip.height)
    sample = {int(row): number for number, row in enumerate(rows)}
    frames = {int(index): row for row, index in enumerate(track.index)}
    chosen = {int(index) for index in np.linspace(0, len(track.index) - 1, SURVEY_FRAMES).round()}
    sheet: list[Picture] = []
    with atomic_path(path) as temporary:
        writer = cv2.VideoWriter(str(temporary), cv2.VideoWriter.fourcc(*codec), roll.sampling_rate, size)
        if not writer.isOpened():
            raise SysidError(f"--overlay {path}: this system cannot write such a film; try .avi.")
        try:
            for frame in clip.frames():
                row = frames.get(frame.index)
                if row is None:
                    continue
                picture = frame.colour
                _annotate(picture, track.points[row], joined, roll, sample.get(row))
                writer.write(picture)
                if row in chosen:
                    small = cv2.resize(picture, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
                    sheet.append(np.asarray(small, np.uint8))
        finally:
            writer.release()
    _write_sheet(sheet, path.with_suffix(".png"))


def _annotate(
    picture: Picture, points: Array, joined: tuple[tuple[int, int], ...], roll: Roll, number: int | None
) -> None:
    seen = np.asarray(np.isfinite(points).all(axis=1), np.bool_)
    colour = LOST_COLOUR if number is None else SEEN_COLOUR
    # The ends of lines need no circles, which would hide what the line lies on.
    for x, y in points[seen] if len(joined) < 2 else ():
        cv2.circle(picture, (round(16 * x), round(16 * y)), 64, colour, 2, cv2.LINE_AA, shift=4)
    for pair in joined:
        if seen[list(pair)].all():
            ends = np.round(16 * points[list(pair)]).astype(np.int32)
            cv2.polylines(picture, [ends], False, colour, 2, cv2.LINE_AA, shift=4)
    height, width = picture.shape[:2]
    strip = picture[height - 64 :]
    strip[:] = (strip * 0.35).astype(np.uint8)
    span = max(float(np.abs(roll.roll).max()), 1e-3)
    across = 8 + (width - 16) * (roll.time - roll.time[0]) / (roll.time[-1] - roll.time[0])
    down = height - 32 - 26 * roll.roll / span
    trace = np.round(16 * np.stack([across, down], axis=1)).astype(np.int32)
    cv2.polylines(picture, [trace], False, (200, 200, 200), 1, cv2.LINE_AA, shift=4)
    if number is None:
        why = "does not turn as one body" if seen.any() else "not seen"
        _text(picture, f"left out: {why}", LOST_COLOUR)
        return
    cv2.circle(picture, trace[number].tolist(), 72, SEEN_COLOUR, -1, cv2.LINE_AA, shift=4)
    angle, deviation = np.degrees(roll.roll[number]), np.degrees(roll.std[number])
    _text(picture, f"{roll.time[number]:7.3f} s   roll {angle:+7.2f} +- {2 * deviation:.2f} deg", SEEN_COLOUR)


def _text(picture: Picture, text: str, colour: Colour) -> None:
    strip = picture[:40]
    strip[:] = (strip * 0.35).astype(np.uint8)
    size = 0.5 + picture.shape[1] / 2400
    cv2.putText(picture, text, (12, 28), cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)


def _write_sheet(pictures: list[Picture], path: Path) -> None:
    columns = 8
    rows = SURVEY_FRAMES // columns
    blank = np.zeros_like(pictures[0])
    cells = [*pictures, *[blank] * (columns * rows)][: columns * rows]
    sheet = np.vstack([np.hstack(cells[row * columns : (row + 1) * columns]) for row in range(rows)])
    with atomic_path(path) as temporary:
        cv2.imwrite(str(temporary), sheet)
