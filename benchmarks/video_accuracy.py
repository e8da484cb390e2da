"""Roll from rendered films against the roll that was rendered: every nuisance alone, and all at once.

    MUJOCO_GL=egl python benchmarks/video_accuracy.py [--films DIR] [--only marker] [--cases 720p60] [--long]

Films are kept in DIR and used again. Writes benchmarks/results/video_accuracy.md.
"""

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from sim.film import Camera, film, frame_times
from sim.film_set import rock
from sysid.errors import HuskyError
from sysid.free_decay import free_decay
from sysid.releases import find_releases
from sysid.roll import Roll
from sysid.video.camera import Lens, write_calibration
from sysid.video_roll import VideoOptions, roll_from_video
from sysid.workspace import Workspace

LEVEL = Camera(pitch_deg=0.0, width=640, height=360, focal=1.4)
ALL = Camera(
    yaw_deg=6, pitch_deg=8, roll_deg=1.5, exposure=1 / 240, noise=2.5, jitter=0.1, readout=0.012,
    shake_deg=0.1, distortion=-0.03, hand=(0.62, 0.70),
)  # fmt: skip
ALONE = {
    "tripod, square": LEVEL,
    "camera looks down 15°": replace(LEVEL, pitch_deg=15.0),
    "camera 15° to the side": replace(LEVEL, yaw_deg=15.0),
    "blur: 1/100 s": replace(LEVEL, exposure=1 / 100, instants=9),
    "noise: 6 grey levels": replace(LEVEL, noise=6.0),
    "variable rate ±20 %": replace(LEVEL, jitter=0.2),
    "rolling shutter 14 ms, given": replace(LEVEL, readout=0.014),
    "rolling shutter 14 ms, unknown": replace(LEVEL, readout=0.014),
    "shake 0.3°": replace(LEVEL, shake_deg=0.3),
    "lens k1 -0.1, calibrated": replace(LEVEL, distortion=-0.1),
    "hand in front for 80 ms": replace(LEVEL, hand=(0.62, 0.70)),
}
"""One nuisance each, 640x360 at 60 frames/s, marker."""
TOGETHER = {
    "all at once, 720p60": ALL,
    "all at once, 1080p60": replace(ALL, width=1920, height=1080),
    "all at once, 720p240": replace(ALL, fps=240.0, exposure=1 / 480, readout=0.004, instants=2),
}
"""Every nuisance at once, every method."""
MARKS = {"marker": "marker", "dots": "dots", "edge": "edge", "features": "none"}
TARGET = {"marker": 0.15, "dots": 0.3, "edge": 0.3, "features": 0.5}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--films", type=Path, default=Path(tempfile.gettempdir()) / "husky-films")
    parser.add_argument("--only", choices=MARKS, action="append")
    parser.add_argument("--cases", default="")
    parser.add_argument("--long", action="store_true", help="every method in 1080p and at 240 frames/s, too")
    arguments = parser.parse_args()
    arguments.films.mkdir(parents=True, exist_ok=True)
    board = Workspace(Path()).load_board("pink")
    motion = rock(board, 1.4, ((0.25, 0.45), (0.95, -0.4)))
    jobs = [(name, camera, method) for name, camera in TOGETHER.items() for method in MARKS]
    jobs = [*jobs[:4], *((name, camera, "marker") for name, camera in ALONE.items()), *jobs[4:]]
    if not arguments.long:
        jobs = [job for job in jobs if job[2] == "marker" or "720p60" in job[0]]
    rows = []
    for name, camera, method in jobs:
        if arguments.cases in name and method in (arguments.only or MARKS):
            rows.append(row(arguments.films, board, motion, name, camera, method))
            print("| " + " | ".join(rows[-1]) + " |", flush=True)
            if not arguments.only and not arguments.cases:  # a table of what is done, whenever it is stopped
                write(rows, "")
    if not arguments.only and not arguments.cases:
        write(rows, speed(arguments.films, board))


def write(rows, ending):
    head = ("film", "method", "frames", "RMSE [°]", "largest [°]", "95 % covers", "k off [%]", "d off [%]")
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows)]
    output = Path(__file__).parent / "results" / "video_accuracy.md"
    output.write_text(HEAD + "\n".join(lines) + "\n" + (f"\n{ending}" if ending else ""))


HEAD = f"""# Roll from rendered films

`benchmarks/video_accuracy.py`; the compliant board, released twice, 1.4 s, filmed by `sim/film.py`. Targets (RMSE):
{", ".join(f"{method} {target}°" for method, target in TARGET.items())}; 95 % intervals should cover 90–98 %. The clock's constant
offset (exposure, and read-out where it is not given) and the rest angle are taken out first; k and d are those of
`decay` on the film against `decay` on the truth at 1 kHz.

"""


def row(folder, board, motion, name, camera, method):
    path = folder / f"{''.join(c if c.isalnum() else '_' for c in name)}-{method}.mp4"
    stamps = frame_times(camera, motion.time[-1], np.random.default_rng(0))
    if not path.exists():
        film(path, board, motion, MARKS[method], camera)
    options = VideoOptions(method=method)
    if "given" in name:
        options = replace(options, readout=camera.readout)
    if "calibrated" in name:
        lens = Lens(camera.matrix, np.array([camera.distortion, 0, 0, 0, 0]), True, "")
        calibration = path.with_suffix(".json")
        calibration.write_text(write_calibration(lens, (camera.width, camera.height)))
        options = replace(options, calibration=calibration)
    try:
        roll = roll_from_video(path, options)
    except HuskyError as error:
        return (name, method, "refused", str(error)[-60:], "", "", "", "")
    error, coverage = against(roll, motion, stamps[0] + camera.readout / 2)
    try:
        (k, d), (true_k, true_d) = numbers(roll, board), numbers(truth(motion), board)
    except HuskyError:  # no free decay is recognised in the film
        k = d = true_k = true_d = np.nan
    return (
        name, method, str(len(roll.time)), f"{np.degrees(np.sqrt(np.mean(error**2))):.3f}",
        f"{np.degrees(np.abs(error).max()):.2f}", f"{100 * coverage:.0f} %",
        f"{100 * (k / true_k - 1):+.2f}", f"{100 * (d / true_d - 1):+.2f}",
    )  # fmt: skip


def against(roll, motion, start):
    """Error of each sample [rad] and the share within the stated 95 % intervals."""

    def error(offset):
        difference = roll.roll - motion.at(roll.time + start + offset)
        return difference - np.median(difference[-15:])

    offsets = np.linspace(-0.008, 0.008, 161)
    best = min(offsets, key=lambda offset: np.sum((error(offset) / roll.std) ** 2))
    return error(best), np.mean(np.abs(error(best)) < 1.96 * roll.std)


def truth(motion):
    part = slice(None, None, 5)
    time_, angle = motion.time[part], motion.roll[part]
    noise = np.random.default_rng(1).normal(0, 1e-5, len(angle))
    return Roll(log="truth", time=time_, roll=angle + noise, std=np.full(len(angle), 1e-5), origin="angle")


def numbers(roll, board):
    decay = free_decay(find_releases(roll), board.inertia)
    return decay.numbers.stiffness.value, decay.numbers.damping.value


def speed(folder, board):
    """Wall time of marker mode against merely decoding the same 1080p film, both warm, best of three."""
    path = folder / "speed.mp4"
    if not path.exists():
        film(
            path,
            board,
            rock(board, 4.0, ((0.3, 0.4),)),
            "marker",
            Camera(width=1920, height=1080, samples=1, instants=2),
        )

    def decode():
        capture = cv2.VideoCapture(str(path))
        while capture.read()[0]:
            pass

    def measure(work):
        times = []
        for _ in range(3):
            begin = time.perf_counter()
            work()
            times.append(time.perf_counter() - begin)
        return min(times)

    bare = measure(decode)
    whole = measure(lambda: roll_from_video(path, VideoOptions(method="marker")))
    return f"1080p, 4 s, MPEG-4: decoding alone {bare:.2f} s, roll in marker mode {whole:.2f} s: {whole / bare:.2f} times.\n"


if __name__ == "__main__":
    main()
