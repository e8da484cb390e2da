"""The angle from points: exact without noise, honest with it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid.video.film.shake import still
from sysid.video.film.track import Track
from sysid.video.pose.angle import fit_angle
from sysid.video.pose.camera_state import CameraState
from sysid.video.pose.prior import BODY_FLOOR, BodyPrior
from sysid.video.pose.rectify import project, upright
from sysid.video.pose.view import View
from sysid.video.trackers.dots import fit_pivot
from sysid.video.trackers.features import TEXTURE

SQUARE_BODY = BodyPrior(square=True)
MATRIX = np.array([[1000.0, 0, 640], [0, 1000, 360], [0, 0, 1]])
SQUARE = np.array([[-0.04, -0.14], [0.04, -0.14], [0.04, -0.06], [-0.04, -0.06]])


def swing(rate=12.0, amplitude=0.45):
    time = np.arange(150) / 60
    return amplitude * np.exp(-1.5 * time) * np.cos(rate * time)


def sheared(angle_at, stamps, readout, yaw, pitch):
    """Points of which each is where it is when its row is read."""
    rows = picture(angle_at(stamps), yaw, pitch)
    for _ in range(30):
        times = stamps[:, None] + readout * rows[..., 1] / 720
        rows = np.stack([picture(angle_at(times[:, j]), yaw, pitch)[:, j] for j in range(4)], axis=1)
    return rows


def picture(angle, yaw, pitch, shape=SQUARE, depth=None, distance=1.2, shift=0.0):
    """Points of a body that turns about an axis through (0, 0) at `distance`, seen by a tilted pinhole."""
    depth = np.zeros(len(shape)) if depth is None else depth
    turned = (shape[:, 0] + 1j * shape[:, 1]) * np.exp(1j * angle)[:, None] + shift
    body = np.stack([turned.real, turned.imag, np.broadcast_to(distance + depth, turned.shape)], axis=-1)
    ey, ep = np.sin(yaw), np.sin(pitch)
    axis = np.array([ey, ep, np.sqrt(1 - ey**2 - ep**2)])
    right = np.array([axis[2], 0, -axis[0]]) / np.hypot(axis[0], axis[2])
    seen = body @ np.stack([right, np.cross(axis, right), axis])
    return seen[..., :2] / seen[..., 2:] * 1000 + [640, 360]


def as_affine(points):
    """Points as one follows them who lays an affine motion through them, shape (n, N, 2)."""
    flat = np.column_stack([np.ones(points.shape[1]), points[len(points) // 2]])
    return flat @ np.linalg.pinv(flat) @ points


def view(points, fps=60.0, rows=720):
    """Points as a straight lens shows them to a still camera."""
    n = len(points)
    track = Track(np.arange(n) / fps, points.astype(np.float32), still(n, MATRIX), np.arange(n), 0)
    return View.of(track, lambda points: points, lambda points: points[..., 1] / rows)


def known(yaw=np.nan, pitch=np.nan, focal=0.0, readout=0.0):
    """Direction not known where it is NaN; the rest given."""
    value = np.array([yaw, pitch, focal, readout])
    std = np.where(np.isnan(value), np.radians(15), 0.0)
    return CameraState(np.nan_to_num(value), np.diag(std**2))


@settings(deadline=None, max_examples=15)
@given(st.floats(-0.25, 0.25), st.floats(-0.25, 0.25))
def test_exact_points_give_the_exact_angle_from_any_camera(yaw, pitch):
    angle = swing()
    turning = fit_angle(view(picture(angle, yaw, pitch)), MATRIX, known(), SQUARE_BODY)
    error = turning.angle - angle
    assert np.abs(error - np.median(error)).max() < 2e-3


def test_a_camera_at_a_slant_matters_and_is_found():
    angle = swing()
    points = picture(angle, 0.25, 0.05)
    naive = fit_angle(view(points), MATRIX, known(0.0, 0.0)).angle - angle
    turning = fit_angle(view(points), MATRIX, known(), SQUARE_BODY)
    assert np.ptp(naive) > 5 * np.ptp(turning.angle - angle)
    assert turning.camera_state.value[0] == pytest.approx(0.25, abs=0.02)


@pytest.mark.parametrize(("yaw", "pitch"), [(0.07, 0.02), (0.07, -0.1), (-0.03, 0.08)])
@pytest.mark.parametrize("slope", [0.0, 1.5, 2.7, -2.7, -4.0])
def test_texture_on_a_slanted_side_of_the_deck_tells_how_far_it_turns(slope, yaw, pitch):
    """An upturned tail from below, or the upper side: taken for a plane across the axis it seems to turn up to 26 % further or less far."""
    angle = swing(rate=20.0, amplitude=0.25)
    tail = np.array([[-0.08, -0.09], [0.08, -0.09], [0.08, -0.04], [-0.08, -0.04]])
    depth = slope * (tail[:, 1] + 0.065)
    points = picture(angle, yaw, pitch, tail, depth, distance=0.75, shift=-0.75 * (yaw + 1j * pitch) + 0.06j)
    swinging = np.abs(angle) > 0.07
    noisy = points + BODY_FLOOR * np.random.default_rng(0).normal(size=points.shape)
    turning = fit_angle(view(as_affine(noisy)), MATRIX, known(), TEXTURE)
    error = turning.angle - angle
    assert np.polyfit(angle, turning.angle, 1)[0] == pytest.approx(1, abs=0.01)
    assert np.median((turning.std / np.abs(angle))[swinging]) < 0.02
    assert np.sqrt(np.mean(((error - np.median(error[-60:])) / turning.std)[swinging] ** 2)) < 2.0


@pytest.mark.parametrize("noise", [0.05, 0.3])
def test_stated_deviations_are_true(noise):
    angle = swing()
    scores = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        points = picture(angle, 0.1, 0.15)
        noisy = points + noise * rng.normal(size=points.shape)
        turning = fit_angle(view(noisy), MATRIX, known(), SQUARE_BODY)
        error = turning.angle - angle
        scores.append((error - np.median(error[-60:])) / turning.std)
    scores = np.concatenate(scores)
    # With little noise it is the doubt about squareness that counts, and this one is square.
    assert 0.9 < np.mean(np.abs(scores) < 1.96) < (0.985 if noise > 0.1 else 0.995)
    assert 0.75 < np.sqrt(np.mean(scores**2)) < 1.25


def test_frames_with_wrong_points_are_left_out():
    angle = swing()
    points = picture(angle, 0.0, 0.1)
    points = points + 0.05 * np.random.default_rng(0).normal(size=points.shape)
    points[120, 0] += 30
    turning = fit_angle(view(points), MATRIX, known(), SQUARE_BODY)
    assert turning.outliers == 1
    assert np.isnan(turning.angle[120])


def test_rolling_shutter_is_undone():
    readout, fps = 0.015, 240
    stamps = np.arange(200) / fps

    def angle_at(time):
        return 0.4 * np.cos(15 * time)

    seen = view(sheared(angle_at, stamps, readout, 0, 0), fps)
    turning = fit_angle(seen, MATRIX, known(0.0, 0.0, 0.0, readout), SQUARE_BODY)
    error = (turning.angle - angle_at(seen.time(readout)))[2:-2]
    assert np.abs(error - np.median(error)).max() < 2e-3
    raw = fit_angle(seen, MATRIX, known(0.0, 0.0), SQUARE_BODY).angle - angle_at(stamps)
    assert np.ptp(raw) > 0.02


@pytest.mark.parametrize("given_pivot", [True, False])
def test_one_dot_about_a_pivot(given_pivot):
    angle = swing()
    points = picture(angle, 0, 0, shape=np.array([[0.0, 0.2]]))
    turning = fit_pivot(view(points), MATRIX, known(0.0, 0.0), pivot=(640.0, 360.0) if given_pivot else None)
    assert np.abs(turning.angle - np.pi / 2 - angle).max() < 1e-6


def test_an_unknown_shutter_is_found():
    readout, fps = 0.012, 120
    stamps = np.arange(150) / fps

    def angle_at(time):
        return 0.4 * np.exp(-0.8 * time) * np.cos(25 * time)

    rows = sheared(angle_at, stamps, readout, 0.05, 0.1)
    rows = rows + 0.05 * np.random.default_rng(0).normal(size=rows.shape)
    std = np.array([0.25, 0.25, 0.2, 0.0024])
    before = CameraState(np.array([0.0, 0.0, 0.0, 1 / 240]), np.diag(std**2), 1 / 60)
    after = fit_angle(view(rows, fps), MATRIX, before, SQUARE_BODY).camera_state
    assert after.std[3] < 0.5 * std[3]
    assert abs(after.readout - readout) < 3 * after.std[3] + 2e-4


def test_what_is_level_stays_level_for_a_camera_that_pans_and_tilts():
    """Half of yaw times pitch is the turn about the line of sight that the shortest way to the axis would leave: 0.6° here."""
    pan, tilt = 0.17, 0.12
    turn_aside = np.array([[np.cos(pan), 0, -np.sin(pan)], [0, 1, 0], [np.sin(pan), 0, np.cos(pan)]])
    turn_down = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    camera = turn_down @ turn_aside
    axis = camera @ [0, 0, 1]
    off = np.arccos(axis[2]) / np.hypot(*axis[:2]) * axis[:2]
    matrix = np.array([[900.0, 0, 320], [0, 900, 180], [0, 0, 1]])
    edge = np.array([[-1.0, 0.5, 5.0], [1.0, 0.5, 5.0]]) @ camera.T @ matrix.T
    left, right = project(upright(matrix, np.array([*off, 0.0])), edge[:, :2] / edge[:, 2:])
    assert np.degrees(np.arctan2(*(right - left)[::-1])) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(("yaw", "pitch"), [(0.24, 0.0), (0.1, 0.17), (0.05, -0.24)])
def test_a_slant_that_may_as_well_be_the_mirrored_one_is_as_vague_as_both(yaw, pitch):
    """Two points, by a camera that looks 14 degrees past the axis: one search ended on the other side, and was sure of it."""
    time, ceiling = np.arange(83) / 60 - 0.3, 1 / 60
    angle = 0.4 * np.where(time < 0, 1.0, np.exp(-10 * time) * np.cos(25 * time))
    ends = np.array([[-0.09, -0.014], [0.09, -0.014]])
    std = [np.radians(15), np.radians(15), 0.25, ceiling / np.sqrt(12)]
    before = CameraState(np.array([0, 0, 0, ceiling / 2]), np.diag(np.square(std)), ceiling)
    points = picture(angle, yaw, pitch, ends, distance=0.8, shift=-0.8 * (yaw + 1j * pitch))
    for seed in (3, 5):
        noisy = points + 0.08 * np.random.default_rng(seed).normal(size=points.shape)
        found = fit_angle(view(noisy), MATRIX, before)
        off = found.camera_state.value[:2] - [yaw, pitch]
        assert np.all(np.abs(off) < 3 * found.camera_state.std[:2])
        error = found.angle - angle
        assert np.mean(np.abs(error - np.median(error[-30:])) < 1.96 * found.std) > 0.85
