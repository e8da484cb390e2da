"""Films as phones write them: trimmed, in slow motion, without a suffix, in other codecs."""

import shutil
import struct
import subprocess
import webbrowser
from itertools import islice

import av
import cv2
import numpy as np
import pytest
from command_line import husky
from drawn_films import decay, draw_film, marked, plate, rmse

from sysid.errors import SysidError
from sysid.logs import LogOptions, read_roll
from sysid.video.film.frames import open_clip
from sysid.video.options import is_film
from sysid.video.overlay import SEEN_COLOUR
from sysid.video_roll import VideoOptions, roll_from_video

TIME = np.arange(60) / 60
ROLL = decay(TIME)


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    return draw_film(tmp_path_factory.mktemp("phone") / "whole.mp4", marked(plate(), 64), ROLL)


def ffmpeg(*arguments):
    if shutil.which("ffmpeg") is None:
        pytest.skip("no ffmpeg to make films of other kinds with")
    command = ["ffmpeg", "-y", "-loglevel", "error", *map(str, arguments)]
    made = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    if made.returncode != 0:
        pytest.skip(f"this ffmpeg makes no such film: {made.stderr.strip()[-80:]}")


def trimmed(film, path, share):
    """The same file with an edit list that shows the first part only, as a phone writes it."""
    data = bytearray(film.read_bytes())
    at = data.index(b"elst")
    version, count = data[at + 4], struct.unpack_from(">I", data, at + 8)[0]
    assert (version, count) == (0, 1)
    length = struct.unpack_from(">I", data, at + 12)[0]
    struct.pack_into(">I", data, at + 12, round(share * length))
    path.write_bytes(data)
    return path


def test_a_trimmed_film_is_read(film, tmp_path):
    short = trimmed(film, tmp_path / "short.mp4", 0.7)
    assert open_clip(short).announced == pytest.approx(42, abs=1)
    roll = roll_from_video(short, VideoOptions(method="marker", readout=0.0))
    assert len(roll.time) == pytest.approx(42, abs=3)
    assert rmse(roll, ROLL) < 0.1


def test_a_film_that_is_cut_off_is_still_refused(film, tmp_path):
    whole = tmp_path / "front.mp4"
    ffmpeg("-i", film, "-c", "copy", "-movflags", "+faststart", whole)
    short = tmp_path / "cut.mp4"
    short.write_bytes(whole.read_bytes()[: whole.stat().st_size * 2 // 3])
    with pytest.raises(SysidError, match="it is cut off"):
        roll_from_video(short)


def test_slow_motion_is_read_at_the_rate_at_which_it_was_filmed(film, tmp_path):
    slow = tmp_path / "slow.mp4"
    ffmpeg(
        "-itsscale", "8", "-i", film, "-c", "copy", "-movflags", "use_metadata_tags", "-metadata",
        "com.android.capture.fps=60.0", slow,
    )  # fmt: skip
    assert open_clip(slow).slowed == pytest.approx(8, rel=0.02)
    roll = roll_from_video(slow, VideoOptions(method="marker", readout=0.0))
    assert roll.sampling_rate == pytest.approx(60, rel=0.02)
    assert any("times the rate at which it plays" in note for note in roll.notes)
    assert rmse(roll, ROLL) < 0.1
    ffmpeg("-itsscale", "4", "-i", film, "-c", "copy", unnoted := tmp_path / "unnoted.mp4")
    notes = roll_from_video(unnoted, VideoOptions(method="marker", readout=0.0)).notes
    assert any("15 frames/s" in note and "slow motion give --rate" in note for note in notes)
    given = roll_from_video(unnoted, VideoOptions(method="marker", readout=0.0, rate=30.0))
    assert given.sampling_rate == pytest.approx(30)


def test_a_mirrored_film_is_refused(tmp_path):
    """Its marker passed for texture, and roll had the other sign."""
    body = marked(plate(contrast=30.0), 64)
    mirrored = draw_film(tmp_path / "selfie.mp4", np.ascontiguousarray(body[:, ::-1]), ROLL)
    with pytest.raises(SysidError, match=r"marker 7 is seen in a mirror.*hflip"):
        roll_from_video(mirrored)
    assert rmse(roll_from_video(mirrored, VideoOptions(method="features")), ROLL) < 0.1


def test_the_read_out_that_an_iphone_notes_is_taken(film, tmp_path):
    noted = tmp_path / "noted.mp4"
    key = "com.apple.quicktime.camera.framereadouttimeinmicroseconds"
    ffmpeg("-i", film, "-c", "copy", "-movflags", "use_metadata_tags", "-metadata", f"{key}=8300", noted)
    assert open_clip(noted).readout == pytest.approx(8.3e-3)
    assert any("8.3 ms, as the phone notes" in note for note in roll_from_video(noted).notes)


@pytest.mark.parametrize("damaged", [30, 59])
def test_a_damaged_picture_costs_itself_only(tmp_path, damaged):
    whole = draw_film(tmp_path / "whole.avi", marked(plate(), 64), ROLL)
    with av.open(str(whole)) as source:
        packet = next(islice(source.demux(video=0), damaged, None))
        at, size = packet.pos, packet.size
    data = bytearray(whole.read_bytes())
    data[at : at + size] = bytes(size)
    (tmp_path / "damaged.avi").write_bytes(data)
    seen = [frame.time for frame in open_clip(tmp_path / "damaged.avi").frames()]
    assert np.round(60 * np.array(seen)).astype(int).tolist() == [k for k in range(60) if k != damaged]
    roll = roll_from_video(tmp_path / "damaged.avi", VideoOptions(method="marker", readout=0.0))
    assert rmse(roll, ROLL) < 0.1


def test_frames_without_stamps_need_the_rate(film, tmp_path):
    bare = tmp_path / "bare.mp4"
    with av.open(str(film)) as source, av.open(str(bare), "w", format="h264") as copy:
        same = copy.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = same
                copy.mux(packet)
    with pytest.raises(SysidError, match=r"carry no time stamps.*--rate"):
        roll_from_video(bare, VideoOptions(method="marker", readout=0.0))
    roll = roll_from_video(bare, VideoOptions(method="marker", readout=0.0, rate=60.0))
    assert len(roll.time) == len(ROLL)
    assert rmse(roll, ROLL) < 0.1


def test_an_edit_that_plays_a_part_slower_is_refused(tmp_path):
    played = np.arange(150) / 60
    filmed = np.minimum(played, 0.9) + np.maximum(played - 0.9, 0) / 4
    ramp = draw_film(tmp_path / "ramp.mp4", marked(plate(), 64), decay(filmed, rate=1.0))
    with pytest.raises(SysidError, match=r"frame rate changes at 0\.[89]"):
        roll_from_video(ramp)


def test_a_preview_shows_what_will_be_followed(film, tmp_path, monkeypatch):
    monkeypatch.setattr(webbrowser, "open", lambda _: False)
    options = ["--rate", "240", "--roi", "0", "0", "600", "300", "--preview", "--front"]
    run = husky("roll", film, "-o", tmp_path / "roll.csv", *options)
    assert run.returncode == 0, run.stderr
    assert "roll.png: follows ArUco 4x4 marker 7" in run.stdout
    page = (tmp_path / "roll.html").read_text()
    assert (
        f'<code id="command">husky-sysid roll {film} -o {tmp_path}/roll.csv --rate 240 --front</code>' in page
    )
    assert not (tmp_path / "roll.csv").exists()
    picture = cv2.imread(str(tmp_path / "roll.png"))
    orange = np.abs(picture.astype(int) - SEEN_COLOUR).max(axis=2) < 30
    assert orange.sum() > 100


def test_a_film_is_known_by_how_it_begins(film, tmp_path):
    bare = shutil.copy(film, tmp_path / "clip")
    assert read_roll(bare, LogOptions(video=VideoOptions(method="marker", readout=0.0))).origin == "video"
    for name, options in {"clip.ts": ["-c", "copy"], "clip.gif": ["-vf", "fps=50"]}.items():
        ffmpeg("-i", film, *options, tmp_path / name)
        assert is_film(tmp_path / name)
    for content in (b"time,roll\n0,1\n", b"RIFF1234WAVEfmt ", b"G" + bytes(400)):
        (tmp_path / "log").write_bytes(content)
        assert not is_film(tmp_path / "log")
    assert not is_film(tmp_path / "none")


HEVC = ["-pix_fmt", "yuv420p10le", "-tag:v", "hvc1", "-x265-params", "log-level=none"]


@pytest.mark.parametrize(("codec", "options"), [("libx264", []), ("libx265", HEVC)])
def test_second_generations_are_read(codec, options, film, tmp_path):
    again = tmp_path / "again.mp4"
    ffmpeg("-i", film, "-c:v", codec, "-b:v", "600k", *options, again)
    roll = roll_from_video(again, VideoOptions(method="marker", readout=0.0))
    assert rmse(roll, ROLL) < min(0.3, 4 * np.degrees(np.median(roll.std)))
