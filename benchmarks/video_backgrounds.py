"""Angle from ten drawn films that differ in the background: none, soft, changing light, moving people.

    python benchmarks/video_backgrounds.py [--only soft] [--keep DIR]

Each film is a plate that turns about a point by a known angle (`tests/support/drawn_films.py`). The tool gets the file alone.
Writes benchmarks/results/video_backgrounds.md and the table of docs/video.md.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from pages import table, write_between, write_result

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from drawn_films import SIZE, Picture, blotches, decay, dotted, draw_film, marked, plate, wall

from sysid.errors import SysidError
from sysid.video_roll import roll_from_video

PAGE = Path(__file__).parents[1] / "docs" / "video.md"
TIME = np.arange(120) / 60
ROLL = decay(TIME, amplitude=0.25, rate=2.0, frequency=20.0)
PLAIN = np.full((SIZE[1], SIZE[0], 3), 150, np.uint8)
PINK, GREEN = (110, 20, 240), (60, 200, 40)
STICKERS = dotted(plate(300, 60), [(-110, -5, 11, PINK), (110, -5, 11, GREEN)])
PRINTS, MARKER, BARE = plate(300, 60, contrast=35.0), marked(plate(260, 90), 70), plate(320, 40)


def soft(seed: int = 2) -> Picture:
    """Return a wall out of focus: colours that change over 8 px or more."""
    rng = np.random.default_rng(seed)
    noise = np.dstack([cv2.GaussianBlur(rng.normal(size=(SIZE[1], SIZE[0])), (0, 0), 8.0) for _ in range(3)])
    return np.clip(140 + 14 * noise / noise.std(), 0, 255).astype(np.uint8)


def curtain(number: int) -> Picture:
    """Return soft folds that sway sideways by up to 6 px."""
    x = np.arange(SIZE[0]) + 6 * np.sin(2 * np.pi * 0.7 * TIME[number])
    folds = 140 + 25 * np.sin(x / 14) + 15 * np.sin(x / 33 + 1)
    return np.repeat(np.repeat(folds[None, :, None], SIZE[1], 0), 3, 2).astype(np.uint8)


def light(behind: Picture) -> Callable[[int], Picture]:
    """Return a background under light that falls to 60 % and flickers by 5 %."""

    def at(number: int) -> Picture:
        gain = 1 - 0.4 * min(number / 90, 1.0) + 0.05 * np.sin(2.1 * number)
        return np.clip(behind * gain, 0, 255).astype(np.uint8)

    return at


def people(behind: Picture) -> Callable[[int], Picture]:
    """Return a background in which two people in patterned clothes walk past, one to either side."""
    clothes = [blotches((240, 70), level, 30.0, seed) for level, seed in ((80.0, 7), (190.0, 8))]

    def at(number: int) -> Picture:
        picture = behind.copy()
        for pattern, left in zip(clothes, (-70 + 6 * number, 640 - 5 * number), strict=True):
            low, high = max(left, 0), min(left + 70, SIZE[0])
            if low < high:
                picture[100:340, low:high] = pattern[:, low - left : high - left]
        return picture

    return at


def held(number: int) -> tuple[float, float]:
    """Return the shift of a camera held by hand [px]."""
    return 3 * float(np.sin(6 * TIME[number])), 2 * float(np.sin(4 * TIME[number] + 1))


FILMS = {
    "no background, stickers": (STICKERS, PLAIN, None),
    "no background, bare edge": (BARE, PLAIN, None),
    "soft wall, stickers": (STICKERS, soft(), None),
    "soft wall, prints": (PRINTS, soft(3), None),
    "curtain that sways, stickers": (STICKERS, curtain, None),
    "curtain that sways, prints": (PRINTS, curtain, None),
    "light changes, marker": (MARKER, light(wall()), None),
    "light changes, soft wall, prints": (PRINTS, light(soft(4)), None),
    "people walk past, stickers": (STICKERS, people(wall()), None),
    "people walk past, camera held by hand, marker": (MARKER, people(wall(30.0)), held),
}
"""Body, background and the camera's shift."""


def row(name: str, folder: Path) -> list[str]:
    """Film one of `FILMS` and read it; return the cells of the table."""
    body, behind, move = FILMS[name]
    path = folder / f"{''.join(c if c.isalnum() else '_' for c in name)}.mp4"
    if not path.exists():
        draw_film(path, body, ROLL, background=behind, move=move)
    try:
        roll = roll_from_video(path)
    except SysidError as error:
        return [name, f"refused: {str(error).removeprefix(f'{path}: ')[:70]}", "", "", ""]
    error = roll.roll - np.interp(roll.time, TIME, ROLL)
    error -= error.mean()
    follows = next(note for note in roll.notes if note.startswith("follows: "))
    inside = np.mean(np.abs(error) < 1.96 * roll.std)
    shake = next((note for note in roll.notes if note.startswith(("shake", "camera"))), "")
    return [name, follows[9:].split(":")[0].split(";")[0], f"{np.degrees(error.std()):.3f}", f"{100 * inside:.0f} %", shake]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="")
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "husky-backgrounds")
    arguments = parser.parse_args()
    arguments.keep.mkdir(parents=True, exist_ok=True)
    rows: list[list[str]] = []
    for name in FILMS:
        if arguments.only in name:
            rows.append(row(name, arguments.keep))
            print(*rows[-1], sep=" | ", flush=True)
    if arguments.only:
        return
    titles = ["film", "what is followed", "RMSE [°]", "95 % covers", "camera"]
    write_result("video_backgrounds.md", f"# Films with other backgrounds\n\n`benchmarks/video_backgrounds.py`: drawn films, 640x360 at 60 frames/s, of a plate that is let go at 14°.\n\n{table(titles, rows)}")
    write_between(PAGE, "backgrounds", table(titles[:3], [cells[:3] for cells in rows]))


if __name__ == "__main__":
    main()
