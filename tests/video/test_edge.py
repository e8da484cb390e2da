"""The deck's edges: what turns as one about a point is the deck's end, and tells the turn; nothing else does."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from frames import frame_of

from sysid.video.film.shake import still
from sysid.video.film.survey import Survey
from sysid.video.film.track import Track
from sysid.video.pose.camera_state import CameraState
from sysid.video.pose.rectify import project, upright
from sysid.video.pose.view import View
from sysid.video.trackers._base import DIRECTION_STD, UNSEEN_DIRECTION_STD
from sysid.video.trackers._edge_profile import PIECES
from sysid.video.trackers.edge.body import fit_edges
from sysid.video.trackers.edge.far_end import LENGTH, axis_vanishes_at
from sysid.video.trackers.edge.find import find_deck_end
from sysid.video.trackers.edge.follower import EdgeFollower
from sysid.video.trackers.edge.turn import fit_direction

TIME = np.arange(90) / 60
ROLL = np.where(TIME < 0.3, 0.4, 0.4 * np.exp(-4 * (TIME - 0.3)) * np.cos(25 * (TIME - 0.3)))
EDGE = np.repeat([0, 1], PIECES)
PIVOT = 330 + 190j
HEIGHT, WIDTH = 360, 640


def turned_edges(roll, late=None, begin=-90):
    """Points of two edges, 20 px apart, the lower one seen on one side; read late by a rolling shutter [s/row]."""
    x = np.concatenate([np.linspace(begin, 90, PIECES), np.linspace(10, 90, PIECES)])
    body = x + 1j * np.where(EDGE == 0, -10, 10)
    time = np.repeat(TIME[:, None], len(body), axis=1)
    for _ in range(4):
        place = PIVOT + body * np.exp(1j * np.interp(time, TIME, roll))
        time = TIME[:, None] + (0 if late is None else late * place.imag)
    # Along the edge nothing tells one point from the next: they stay even there.
    turn = np.exp(1j * np.interp(TIME + (0 if late is None else late * PIVOT.imag), TIME, roll))[:, None]
    across = ((place - PIVOT) / turn).imag
    place = PIVOT + (body.real + 1j * across) * turn
    noise = 0.1 * np.random.default_rng(0).normal(size=place.shape)
    return place + 1j * turn * noise


def error_of(angle, roll=ROLL):
    error = angle - roll
    return np.degrees(error - np.median(error[-20:]))


def test_points_that_do_not_turn_with_the_deck_are_not_believed():
    z = turned_edges(ROLL)
    level = np.abs(ROLL) < 0.05
    # When the deck is level, the upper edge's outer half is lost to the outline of a long side.
    outline = np.where(
        level[:, None] & (np.arange(2 * PIECES) < PIECES // 2), -4 + 0.04 * np.arange(2 * PIECES), 0
    )
    body = fit_edges(z + 1j * outline, EDGE, np.full(len(EDGE), PIVOT + 5 - 9j))
    assert np.abs(error_of(body.angle)).max() < 0.2
    assert body.weight[level][:, : PIECES // 2].mean() < 0.05
    row = int(np.flatnonzero(level)[0])
    straight = np.polyfit(z[row, :PIECES].real, (z + 1j * outline)[row, :PIECES].imag, 1)[0] - ROLL[row]
    assert np.degrees(np.abs(straight)) > 0.5  # what a line through all of them would make of it


def test_points_count_as_what_is_beside_them_lets_them():
    """Half of each edge is off by a few tenths of a pixel while the deck is held, too little to stand out, and known to be doubtful there."""
    rng = np.random.default_rng(4)
    held = (TIME < 0.3)[:, None] & (np.arange(2 * PIECES) % PIECES < PIECES // 2)
    off = held * 0.4 * rng.choice([0.5, 1.0], 2 * PIECES)
    z = turned_edges(ROLL) + 1j * np.exp(1j * ROLL)[:, None] * off
    alike, weighed = (
        error_of(fit_edges(z, EDGE, np.full(len(EDGE), PIVOT), doubt).angle)[TIME < 0.3]
        for doubt in (0.0, np.where(held, 0.3, 0.0))
    )
    assert np.abs(weighed).mean() < 0.5 * np.abs(alike).mean()


def test_a_part_of_a_concave_edge_tells_level_and_turn_though_points_slide_along_it():
    """Where the pivot was taken to be 30 px too high, the same points are elsewhere on the edge as the deck turns."""
    taken = PIVOT - 4 - 30j
    slid = ((PIVOT - taken) * np.exp(-1j * ROLL)).real[:, None]
    along = np.linspace(-130, 20, PIECES) - slid
    z = PIVOT + (along - 1j * (90 + 0.0012 * along**2 / 2)) * np.exp(1j * ROLL)[:, None]
    z = z + 0.1j * np.exp(1j * ROLL)[:, None] * np.random.default_rng(0).normal(size=z.shape)
    body = fit_edges(z, np.zeros(PIECES, int), np.full(PIECES, taken))
    gain, level = np.polyfit(ROLL, body.angle, 1)
    assert abs(gain - 1) < 0.01
    assert abs(gain - 1) < 2 * body.scale_std < 0.03
    assert abs(np.degrees(level)) < 0.05


def film_of(z):
    points = np.stack([z.real, z.imag], axis=-1).astype(np.float32)
    track = Track(TIME, points, still(len(TIME), 1000.0, 0j), np.arange(len(TIME)), 0)
    return View(track, lambda points: points, lambda points: points[..., 1] / HEIGHT)


def test_a_rolling_shutter_is_taken_out_by_the_turn_about_the_pivot():
    readout, roll = 0.014, 0.4 * np.cos(25 * TIME)
    z = turned_edges(roll, readout / HEIGHT, begin=0)
    view = film_of(z)
    matrix = np.array([[900.0, 0, 320], [0, 900, 180], [0, 0, 1]])
    truth = np.interp(TIME + readout * view.share, TIME, roll)
    errors = []
    for given in (readout, 0.0):
        known = CameraState(np.array([0, 0, 0, given]), np.zeros((4, 4)))
        turning = fit_direction(view, matrix, known, pivot=np.full((2, 2), [330.0, 185.0]))
        error = np.degrees(turning.angle - truth)[1:-1]
        errors.append(np.std(error))
    assert errors[0] < 0.08  # the points' noise
    assert errors[1] > 0.1


def test_where_the_axis_vanishes_tells_how_a_slanted_view_squeezes_the_turn():
    matrix = np.array([[900.0, 0, 320], [0, 900, 180], [0, 0, 1]])
    focal = 1.15  # of the camera, in the lens's
    aside = np.linalg.inv(upright(matrix, np.array([0.25, -0.1, np.log(focal)])))
    z = turned_edges(ROLL)
    seen = project(aside, np.stack([z.real, z.imag], axis=-1)) @ [1, 1j]
    vanishing = project(aside, np.array([[320.0, 180.0]]))[0]
    pivot = project(aside, np.array([[330.0, 190.0]]))[0]
    view = film_of(seen)
    straight, slanted = (
        fit_direction(
            view,
            matrix,
            CameraState(np.zeros(4), np.diag([std, std, 0.25, 0.0]) ** 2),
            pivot=np.tile(pivot, (2, 1)),
            vanishing=place,
        )
        for std, place in ((UNSEEN_DIRECTION_STD, None), (DIRECTION_STD, (vanishing, 20.0)))
    )
    assert np.std(error_of(slanted.angle)) < 0.35 * np.std(error_of(straight.angle))
    assert np.max(slanted.std) < 0.5 * np.max(straight.std)
    assert np.mean(np.abs(error_of(slanted.angle)) < 2 * np.degrees(slanted.std)) > 0.95
    # A longer lens sees the same place at a smaller angle: what is known of both goes together.
    state = slanted.camera_state
    there = project(np.linalg.inv(upright(matrix, state.value)), np.array([[320.0, 180.0]]))[0]
    assert there == pytest.approx(vanishing, abs=10)
    assert state.covariance[0, 2] < 0 < state.covariance[1, 2]


def picture(roll, *, upper_side=True):
    """A deck's end with its upper side, its wheels and the horizon behind it."""
    image = np.full((HEIGHT, WIDTH), 130, np.uint8)
    image[200:] = 70
    for x in (250, 390):
        cv2.rectangle(image, (x - 20, 215), (x + 20, 260), 220, -1)
    cv2.rectangle(image, (270, 225), (370, 240), 110, -1)
    end = np.array([-90 - 10j, 90 - 10j, 90 + 10j, -90 + 10j]) * np.exp(1j * roll) + 320 + 200j
    far = (end[:2] - 320 - 110j) * 0.6 + 320 + 110j  # farther from the camera, which looks down a little
    for shape, shade in (([end[0], end[1], far[1], far[0]], 45), (end, 60))[not upper_side :]:
        corners = np.round(16 * np.array([[p.real, p.imag] for p in shape])).astype(np.int32)
        cv2.fillPoly(image, [corners], shade, cv2.LINE_AA, shift=4)
    noise = np.random.default_rng(int(1e4 * abs(roll))).normal(0, 1.5, image.shape)
    return np.clip(cv2.GaussianBlur(image.astype(float), (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


def with_a_dark_top(roll):
    """A bright wall and a deck's end under a dark upper side, level with the camera: a strip of it shows where it tilts one way."""
    fine = np.full((4 * HEIGHT, 4 * WIDTH), 200, np.uint8)
    cv2.rectangle(fine, (4 * 250, 4 * 280), (4 * 390, 4 * 310), 120, -1)
    pivot, eye = 320 + 330j, 350 + 217j
    end = np.array([-150 - 108j, 150 - 108j, 150 - 52j, -150 - 52j]) * np.exp(1j * roll) + pivot
    top = np.array([-145 - 105j, 145 - 105j]) * np.exp(1j * roll) + pivot
    far = (top - eye) * 0.43 + eye
    for shape, shade in (([*top, *far[::-1]], 45), (end, 110)):
        corners = np.round(16 * (4 * np.array([[p.real, p.imag] for p in shape]) + 1.5)).astype(np.int32)
        cv2.fillPoly(fine, [corners], shade, cv2.LINE_AA, shift=4)
    image = cv2.resize(fine.astype(np.float32), (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(int(1e4 * abs(roll))).normal(0, 1.5, image.shape)
    return np.clip(cv2.GaussianBlur(image, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


def test_the_deck_end_is_followed_where_its_upper_side_shows_now_and_then():
    roll = 0.5 * ROLL
    frames = tuple(
        frame_of(n, time, with_a_dark_top(at)) for n, (time, at) in enumerate(zip(TIME, roll, strict=True))
    )
    end = find_deck_end(Survey(frames[10:70:3], (140, 140, 500, 320), np.ones((HEIGHT, WIDTH), bool)))
    assert end is not None
    tracker = EdgeFollower(end, frames[0].box)
    z = np.array([tracker.update(frame) for frame in frames]) @ [1, 1j]
    known = CameraState(np.zeros(4), np.zeros((4, 4)))
    matrix = np.array([[900.0, 0, 320], [0, 900, 180], [0, 0, 1]])
    found = fit_direction(film_of(z), matrix, known, pivot=end.pivot)
    assert np.isfinite(found.angle).all()
    assert np.std(np.degrees(found.angle - roll)) < 0.03


@pytest.fixture(scope="module")
def swing():
    rolls = ROLL[10:70:3]
    pictures = tuple(picture(roll) for roll in rolls)
    moving = np.ones((HEIGHT, WIDTH), bool)
    frames = tuple(frame_of(number, number / 60, one) for number, one in enumerate(pictures))
    look = Survey(frames, (210, 120, 430, 290), moving)
    return rolls, look


def test_the_deck_end_is_what_coincides_when_pictures_are_turned_back(swing):
    rolls, look = swing
    end = find_deck_end(look)
    assert end is not None
    across = end.pivot[:, 1] + end.ends[:, 0, 1]
    assert np.abs(across - 190).min() < 2  # its upper edge, when it is level,
    assert np.abs(across - 158).min() < 2  # and, from farther away, that of the other end:
    assert all(min(abs(at - 190), abs(at - 210), abs(at - 158)) < 3 for at in across)  # not the horizon
    assert np.ptp(end.ends[..., 0], axis=1).max() > 140
    off = np.degrees(end.turns - rolls)
    assert np.abs(off - np.median(off)).max() < 0.6


def test_its_far_end_shows_where_the_axis_vanishes(swing):
    """It is drawn 0.6 times as large, and turns about a point 36 px above the near one's."""
    end = find_deck_end(swing[1])
    assert end is not None
    assert np.abs(end.pivot[:, 1] - 200).min() < 5
    assert np.abs(end.pivot[:, 1] - 164).min() < 3
    near = np.ptp(end.ends[end.pivot[:, 1] > 182, :, 0], axis=1).max()
    found = axis_vanishes_at(end, 1.5 * LENGTH * float(near))
    assert found is not None
    place, std = found
    assert np.hypot(*(place - [320.0, 110.0])) < 2 * std < 40


def test_no_place_is_where_the_axis_vanishes_if_no_far_end_shows(swing):
    _, look = swing
    plain = tuple(frame_of(n, n / 60, picture(roll, upper_side=False)) for n, roll in enumerate(swing[0]))
    end = find_deck_end(replace(look, frames=plain))
    assert end is not None
    assert axis_vanishes_at(end, 900.0) is None


def test_its_edges_are_followed_into_attitudes_that_were_not_looked_at(swing):
    _, look = swing
    end = find_deck_end(look)
    assert end is not None
    tracker = EdgeFollower(end, look.frames[0].box)
    rolls = np.linspace(-0.45, 0.42, 14)
    points = [tracker.update(frame_of(n, n / 60, picture(roll))) for n, roll in enumerate(rolls)]
    z = np.array([each @ [1, 1j] for each in points])
    edge = np.arange(z.shape[1]) // PIECES
    error = np.degrees(fit_edges(z, edge, np.repeat(end.pivot @ [1, 1j], PIECES)).angle - rolls)
    assert np.abs(error - np.median(error)).max() < 0.3


def test_a_picture_without_the_deck_shows_no_edge(swing):
    _, look = swing
    end = find_deck_end(look)
    assert end is not None
    tracker = EdgeFollower(end, look.frames[0].box)
    wall = np.random.default_rng(2).normal(120, 4, (HEIGHT, WIDTH, 3)).clip(0, 255).astype(np.uint8)
    assert tracker.update(frame_of(0, 0.0, wall)) is None
