"""The printed page: both markers are found in a picture of it, in the size that it states."""

import cv2
import numpy as np
import pytest
from command_line import husky
from frames import frame_of

from sysid.video.trackers.marker import find_marker


def test_both_markers_of_the_page_are_found_in_true_size(tmp_path):
    page = tmp_path / "page.png"
    run = husky("marker", "-o", str(page), "--number", "11", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "ArUco 4x4 markers 11 (80 mm) and 12 (40 mm)" in run.stdout
    picture = cv2.imread(str(page))
    scale = picture.shape[1] / 210
    assert picture.shape[0] / scale == pytest.approx(297, abs=0.5)
    for number, side in ((11, 80.0), (12, 40.0)):
        marker = find_marker(frame_of(0, 0.0, picture), (0, 0, picture.shape[1], picture.shape[0]))
        assert marker.number == number
        edges = np.linalg.norm(np.diff(marker.corners, axis=0), axis=1) / scale
        assert edges == pytest.approx(side, abs=0.5)
        assert marker.corners[0, 1] < marker.corners[3, 1]  # upright, as the arrow beside it says
        cv2.fillPoly(picture, [marker.corners.astype(np.int32)], (255, 255, 255))


def test_the_page_is_one_sheet_of_a4(tmp_path):
    page = tmp_path / "marker.pdf"
    assert husky("marker", "-o", str(page), cwd=tmp_path).returncode == 0
    content = page.read_bytes()
    assert content.count(b"/Type /Page ") == 1
    assert b"/MediaBox [ 0 0 595.2" in content  # 210 mm in points


@pytest.mark.parametrize(("option", "words"), [(["-o", "page.txt"], ".pdf"), (["--number", "49"], "0 to 48")])
def test_what_no_page_can_be_is_refused(option, words, tmp_path):
    run = husky("marker", *option, cwd=tmp_path)
    assert run.returncode == 1
    assert words in run.stderr
    assert list(tmp_path.iterdir()) == []
