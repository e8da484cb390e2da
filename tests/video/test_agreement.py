"""What is followed in a film must turn as one body: edges, patches and dots that do not are found out."""

import warnings
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from frames import frame_of

from sysid.errors import SysidError
from sysid.noise.outliers import lone_outliers
from sysid.video.film.shake import still, still_places
from sysid.video.film.track import Track
from sysid.video.follow import track_of
from sysid.video.pose.angle import fit_angle
from sysid.video.pose.camera_state import CameraState
from sysid.video.pose.prior import BodyPrior
from sysid.video.pose.rectify import rectify
from sysid.video.pose.view import View
from sysid.video.select import Followed, _fault
from sysid.video.trackers.dots import Dot, DotFollower

TIME = np.arange(90) / 60
CAMERA = CameraState(np.zeros(4), np.diag(np.append(np.radians([15.0, 15.0]), [0.25, 0.0]) ** 2))
"""What is known of one before anybody looks."""
ROLL = np.where(TIME < 0.3, 0.4, 0.4 * np.exp(-4 * (TIME - 0.3)) * np.cos(25 * (TIME - 0.3)))


def turned(points, prior):
    track = Track(TIME, points.astype(np.float32), still(len(TIME), 1000.0, 0j), np.arange(len(TIME)), 0)
    view = View(track, lambda points: points, lambda points: points[..., 1] / 720)
    matrix = np.array([[1000.0, 0, 640], [0, 1000, 360], [0, 0, 1]])
    return fit_angle(view, matrix, CameraState(np.zeros(4), np.diag([0.07, 0.07, 0.06, 0.0])), prior)


def places(path, middle):
    place = path + middle
    return np.stack([place.real, place.imag], axis=-1).astype(np.float32)


def test_compression_makes_small_swings_less_certain_than_large_ones():
    rng = np.random.default_rng(1)
    shape = rng.uniform(-90, 90, 20) + 1j * rng.uniform(-25, 25, 20)
    place = np.exp(1j * ROLL)[:, None] * shape
    points = np.stack([place.real, place.imag], axis=-1) + [640, 360] + 0.05 * rng.normal(size=(90, 20, 2))
    prior = BodyPrior(dead_zone=0.15)
    own = turned(points, prior).own
    plain = turned(points, replace(prior, dead_zone=0.0)).own
    left_out = np.sqrt(own**2 - plain**2)
    assert left_out[75:].min() > 3 * left_out[22:35].max()
    assert left_out[80] * np.abs(shape - shape.mean()).max() == pytest.approx(0.15 / np.sqrt(3), rel=0.2)


def test_a_film_whose_stamps_are_garbled_is_refused():
    film = SimpleNamespace(clip=SimpleNamespace(path="film.mp4"), repeated=20)
    with pytest.raises(SysidError, match=r"20 frames carry no later time stamp.*--rate"):
        track_of(film, [(row, row / 60) for row in range(60)], np.zeros((60, 1, 2), np.float32))


def test_lone_frames_are_told_from_a_release():
    angle = ROLL + 0.001 * np.random.default_rng(4).normal(size=90)
    assert not lone_outliers(TIME, angle, rate=False).any()
    angle[50] += 0.15
    off = lone_outliers(TIME, angle, rate=False)
    assert np.flatnonzero(off).tolist() == [50]
    assert off[50] == pytest.approx(0.15, rel=0.2)


def test_a_dot_that_is_covered_in_part_is_not_seen():
    def picture(cover):
        image = np.full((200, 320, 3), (120, 130, 125), np.uint8)
        for x in (80, 240):
            cv2.circle(image, (x, 100), 12, (110, 20, 240), -1, cv2.LINE_AA)
        image[:, 240 : 240 + cover] = (130, 160, 215)
        return cv2.GaussianBlur(image, (0, 0), 0.8)

    shown = frame_of(0, 0.0, picture(0))
    chroma = np.array([plane[50, 40] for plane in shown.chroma]) - 128.0
    dots = tuple(Dot(np.array([x, 100.0]), 12.0, chroma) for x in (80, 240))
    tracker = DotFollower(dots)
    assert tracker.update(shown) is not None
    # Half of it is hidden: the middle of what is left is 5 px off.
    assert tracker.update(frame_of(1, 0.02, picture(60))) is None
    assert tracker.update(frame_of(2, 0.04, picture(0))) is not None


def test_an_angle_that_contradicts_itself_or_is_vague_is_none():
    def fault(angle, std):
        return _fault(
            SimpleNamespace(
                target=SimpleNamespace(what="the edge", shows_body=False),
                track=SimpleNamespace(lost=5, points=np.zeros((90, 1, 2))),
                found=SimpleNamespace(
                    angle=angle,
                    own=np.full(len(angle), std),
                    camera_state=CameraState(np.zeros(4), np.zeros((4, 4))),
                ),
                before=CameraState(np.zeros(4), np.zeros((4, 4))),
                std=std,
                turns=True,
            )
        )

    assert fault(ROLL, 0.01) is None
    assert "seen in 85 of 90 frames, but turns as one body in only 40" in fault(
        np.where(np.arange(90) < 40, 0.0, np.nan), 0.01
    )
    assert "the edge tells the angle to ±20° only" in fault(ROLL, np.radians(10.0))


def test_what_is_carried_past_is_no_board():
    turned = np.exp(1j * ROLL)[:, None] * np.array([150 + 20j, -150 + 10j])
    passing = 200 * np.sin(3 * TIME)[:, None] + 0.1 * turned
    for path, fault in (
        (turned, None),
        (turned + 4 * np.sin(5 * TIME)[:, None], None),
        (passing, "moves along"),
    ):
        track = Track(TIME, places(path, 640 + 360j), still(90, 1000.0, 640 + 360j), np.arange(90), 0)
        one = Followed(
            SimpleNamespace(what="stickers", shows_body=True, shows_turn=True),
            track,
            CAMERA,
            SimpleNamespace(angle=ROLL, std=np.full(90, 0.01), camera_state=CAMERA),
        )
        assert (_fault(one) is None) if fault is None else fault in _fault(one)


def test_an_axis_that_no_camera_looks_along_is_none_of_a_board():
    def fault(yaw):
        state = replace(CAMERA, value=np.array([np.radians(yaw), 0.0, 0.0, 0.0]))
        target, found = (
            SimpleNamespace(what="texture", shows_body=False),
            SimpleNamespace(angle=ROLL, own=np.full(90, 0.01), camera_state=state),
        )
        return _fault(
            SimpleNamespace(
                target=target,
                track=SimpleNamespace(points=np.zeros((90, 1, 2))),
                before=CAMERA,
                found=found,
                std=0.01,
                turns=True,
            )
        )

    assert fault(35.0) is None
    assert "far aside of any camera" in fault(-99.0)


def test_points_that_are_not_seen_are_no_warning():
    matrix = np.array([[1000.0, 0, 640], [0, 1000, 360], [0, 0, 1]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(rectify(np.full((3, 2), np.nan), matrix, np.array([0.1, 0.1, 0.0]))).all()
        motion = np.array([1.0, 2.0, 0.01, 0.0])
        assert np.isnan(still_places(np.array([np.nan + 0j]), motion, 900.0)).all()
