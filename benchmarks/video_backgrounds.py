"""Angle from ten drawn films that differ in the background: none, soft, changing light, moving people.

    python benchmarks/video_backgrounds.py [--only soft] [--keep DIR] [--rows FILE]

Each film is a plate that turns about a point by a known angle (`tests/support/drawn_films.py`). The tool gets the file alone.
Writes benchmarks/results/video_backgrounds.md.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from pages import table, write_result

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from backgrounds import curtain, held, light, people, soft
from drawn_films import SIZE, decay, dotted, draw_film, marked, plate, wall

from sysid.errors import SysidError
from sysid.video_roll import roll_from_video

TIME = np.arange(120) / 60
ROLL = decay(TIME, amplitude=0.25, rate=2.0, frequency=20.0)
PLAIN = np.full((SIZE[1], SIZE[0], 3), 150, np.uint8)
PINK, GREEN = (110, 20, 240), (60, 200, 40)
STICKERS = dotted(plate(300, 60), [(-110, -5, 11, PINK), (110, -5, 11, GREEN)])
PRINTS, MARKER, BARE = plate(300, 60, contrast=35.0), marked(plate(260, 90), 70), plate(320, 40)


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
    shake = next((note.split(",")[0] for note in roll.notes if note.startswith(("shake", "camera"))), "")
    return [
        name,
        follows[9:].split(":")[0].split(";")[0],
        f"{np.degrees(error.std()):.3f}",
        f"{100 * inside:.0f} %",
        shake,
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="")
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "husky-backgrounds")
    parser.add_argument("--rows", type=Path, help="write the rows to this file alone, to compare with later")
    arguments = parser.parse_args()
    arguments.keep.mkdir(parents=True, exist_ok=True)
    rows = [row(name, arguments.keep) for name in FILMS if arguments.only in name]
    titles = ["film", "what is followed", "RMSE [°]", "95 % covers", "camera"]
    if arguments.rows is not None:
        arguments.rows.write_text(json.dumps(rows))
    if arguments.only or arguments.rows is not None:
        print(table(titles, rows))
        return
    head = "`benchmarks/video_backgrounds.py`: drawn films, 640x360 at 60 frames/s, of a plate that is let go at 14°."
    write_result("video_backgrounds.md", f"# Films with other backgrounds\n\n{head}\n\n{table(titles, rows)}")


if __name__ == "__main__":
    main()
