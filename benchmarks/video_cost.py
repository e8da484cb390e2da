"""Time and memory for reading the roll from a film, by each thing that can be followed, against merely decoding it.

    MUJOCO_GL=egl python benchmarks/video_cost.py [--rounds 5] [--repeats 10]

Each works in a process of its own, in turn, several times; the table holds the best of each, because on a shared
machine only ratios measured together mean anything. Memory is the peak resident size (Linux) less what the same
process has after its imports. Writes benchmarks/results/video_cost.md.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import av
from pages import table, write_result

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from film import Camera, film
from film_set import Mark, rock

from sysid.workspace import Workspace

FOLLOWED: dict[Mark, tuple[str, ...]] = {
    "marker": ("marker", "auto"), "dots": ("dots",), "none": ("features", "auto"), "edge": ("edge",),
}  # fmt: skip
"""What is on the deck, and what is asked for."""
DECODE = """
import cv2
def work(path):
    capture = cv2.VideoCapture(path, cv2.CAP_FFMPEG)
    while capture.read()[0]:
        pass
"""
FOLLOW = """
import pathlib, sysid.video.select
from sysid.video_roll import VideoOptions, roll_from_video
def work(path):
    roll_from_video(pathlib.Path(path), VideoOptions(method="{method}"))
"""
WORKER = """
import json, pathlib, re, sys, time
{work}
peak = lambda: int(re.search(r"VmHWM:\\s+(\\d+)", pathlib.Path("/proc/self/status").read_text())[1]) / 1024
before, start, cpu = peak(), time.perf_counter(), time.process_time()
work(sys.argv[1])
print(json.dumps([time.perf_counter() - start, time.process_time() - cpu, peak() - before]))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--repeats", type=int, default=10)
    arguments = parser.parse_args()
    board = Workspace(Path()).load_board("pink")
    with tempfile.TemporaryDirectory() as place:
        camera = Camera(width=1920, height=1080, samples=1)
        cells: list[tuple[str, ...]] = []
        for mark, methods in FOLLOWED.items():
            short, long = Path(place) / f"{mark}.mp4", Path(place) / f"{mark}-long.mp4"
            # It begins and ends level, so that it can be repeated without a jump.
            film(short, board, rock(board, 4.0, ((0.1, 0.0), (1.0, 0.4))), mark, camera)
            repeat(short, long, arguments.repeats)
            for method in methods:
                cells += rows(f"4 s, {mark}", short, method, arguments.rounds)
                cells += rows(f"{4 * arguments.repeats} s, {mark}", long, method, 1)
                print(*cells[-6:], sep="\n", flush=True)
    write_result(
        "video_cost.md",
        "# What reading a film costs\n\n`benchmarks/video_cost.py`: 1920x1080, 60 frames/s, H.264, rendered by "
        "`tests/support/film.py`; decoding is OpenCV's alone.\nBest of several processes in turn; both may use all cores: the processor time is what counts.\n\n"
        + table(("film", "followed", "", "decoding", "reading", "ratio"), cells),
    )


def repeat(film: Path, path: Path, times: int) -> None:
    """Write a film several times over, as one."""
    with av.open(str(film)) as source:
        packets = [packet for packet in source.demux(video=0) if packet.dts is not None]
        assert packets[0].time_base is not None
        span = round(1.0 / 60 / float(packets[0].time_base)) + max(packet.pts or 0 for packet in packets)
        with av.open(str(path), "w") as copy:
            stream = copy.add_stream_from_template(source.streams.video[0])
            for _ in range(times):
                for packet in packets:
                    packet.stream = stream
                    copy.mux(packet)
                    packet.time_base = source.streams.video[0].time_base
                    packet.pts = (packet.pts or 0) + span
                    packet.dts = (packet.dts or 0) + span


def rows(name: str, film: Path, method: str, rounds: int) -> list[tuple[str, ...]]:
    """Return the rows of one film: time, processor time and memory, of decoding and of reading."""
    works = (DECODE, FOLLOW.replace("{method}", method))
    both = zip(
        *(zip(*(measured(work, film) for work in works), strict=True) for _ in range(rounds)),
        strict=True,
    )
    best = [tuple(min(values) for values in zip(*quantity, strict=True)) for quantity in both]
    return [
        (name, method, what, f"{bare:.3g} {unit}", f"{whole:.3g} {unit}", f"{whole / bare:.2f}")
        for (what, unit), (bare, whole) in zip(
            (("time", "s"), ("processor time", "s"), ("peak memory", "MB")), best, strict=True
        )
    ]


def measured(work: str, film: Path) -> list[float]:
    """Seconds, the processor's seconds and MB of one process."""
    code = WORKER.format(work=work)
    result = subprocess.run(
        [sys.executable, "-c", code, str(film)], capture_output=True, text=True, check=True
    )
    return json.loads(result.stdout)


if __name__ == "__main__":
    main()
